#include "server/cli/terminal/text.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "server/base/counted.h"

namespace myograde::server {
namespace {

bool HasColour() {
  const char* no_color = std::getenv("NO_COLOR");
  return ::isatty(STDOUT_FILENO) == 1 && (no_color == nullptr || *no_color == '\0');
}

}  // namespace

std::string Marked(std::string_view text) {
  std::string marked;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size());
    absl::StrAppend(&marked, std::string(kForeignMark),
                    Harmless(text.substr(at, end - at), /*tabs=*/true), "\n");
    at = end + 1;
  }
  return marked;
}

std::string Bold(const std::string& text) {
  return HasColour() ? "\033[1m" + text + "\033[0m" : text;
}

std::string TextAt(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_string() ? it->get<std::string>() : "";
}

std::string Cell(const Json& object, const std::string& key, int digits) {
  const auto it = object.is_object() ? object.find(key) : object.end();
  if (!object.is_object() || it == object.end() || it->is_null()) return "-";
  if (it->is_string()) {
    const std::string text = Harmless(it->get<std::string>());
    return text.empty() ? "-" : text;
  }
  if (it->is_number_float()) return absl::StrFormat("%.*f", digits, it->get<double>());
  return it->dump();
}

std::string ListCell(const Json& object, const std::string& key) {
  std::string list;
  const auto it = object.find(key);
  for (const Json& entry : it == object.end() ? Json() : *it) {
    if (!entry.is_string()) continue;
    absl::StrAppend(&list, list.empty() ? "" : ", ", Harmless(entry.get<std::string>()));
  }
  return list.empty() ? "-" : list;
}

std::string DurationText(double seconds) {
  const auto whole = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
  if (whole < 60) return absl::StrCat(whole, " s");
  if (whole < 3600) return absl::StrCat(whole / 60, " min ", whole % 60, " s");
  return absl::StrCat(whole / 3600, " h ", whole / 60 % 60, " min");
}

std::string CountCell(const Json& object, const std::string& key, const char* one) {
  const auto it = object.is_object() ? object.find(key) : object.end();
  if (!object.is_object() || it == object.end() || !it->is_number_integer()) {
    return absl::StrCat(Cell(object, key), " ", one, "s");
  }
  return Counted(it->get<int64_t>(), one);
}

std::string HashText(const std::string& hash, bool full) {
  constexpr size_t kDigits = 12;
  return full ? hash : hash.substr(0, kDigits);
}

}  // namespace myograde::server
