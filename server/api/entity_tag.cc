#include "server/api/entity_tag.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"

namespace myograde::server {
namespace {

constexpr std::string_view kSpace = " \t,";

}  // namespace

std::string EntityTagOf(std::string_view body) { return absl::StrCat("\"", Sha256Hex(body), "\""); }

bool NamesEntityTag(std::string_view if_none_match, std::string_view tag) {
  std::string_view rest = if_none_match;
  if (rest == "*") return true;
  for (;;) {
    rest.remove_prefix(std::min(rest.find_first_not_of(kSpace), rest.size()));
    if (rest.starts_with("W/")) rest.remove_prefix(2);
    // A tag may have a comma in it, so quotes decide where it ends.
    if (!rest.starts_with('"')) return false;
    const size_t end = rest.find('"', 1);
    if (end == std::string_view::npos) return false;
    if (rest.substr(0, end + 1) == tag) return true;
    rest.remove_prefix(end + 1);
  }
}

}  // namespace myograde::server
