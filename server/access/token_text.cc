#include "server/access/token_text.h"

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/secret.h"

namespace myograde::server {
namespace {

constexpr std::string_view kPrefix = "myo_";
constexpr size_t kRandomBytes = 32;

}  // namespace

absl::StatusOr<std::string> NewTokenText() {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(kRandomBytes));
  return absl::StrCat(std::string(kPrefix), absl::BytesToHexString(bytes));
}

bool IsTokenText(std::string_view text) {
  if (!text.starts_with(kPrefix)) return false;
  text.remove_prefix(kPrefix.size());
  return text.size() == 2 * kRandomBytes &&
         text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::string TokenHash(std::string_view text) { return Sha256Hex(std::string(text)); }

}  // namespace myograde::server
