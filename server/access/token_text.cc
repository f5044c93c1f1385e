#include "server/access/token_text.h"

#include <openssl/rand.h>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"

namespace myograde::server {
namespace {

constexpr std::string_view kPrefix = "myo_";
constexpr size_t kRandomBytes = 32;

}  // namespace

absl::StatusOr<std::string> NewTokenText() {
  std::string bytes(kRandomBytes, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()),
                 static_cast<int>(bytes.size())) != 1) {
    return absl::InternalError("this host has no random numbers for a token; try again");
  }
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
