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

// Appends `text` as Filled makes it; false if a value was missing.
bool Fill(const Json& object, std::string_view text, std::string& filled) {
  bool whole = true;
  for (size_t open; (open = text.find_first_of("{[")) != std::string_view::npos;) {
    filled += text.substr(0, open);
    const bool optional = text[open] == '[';
    const size_t close = text.find(optional ? ']' : '}', open);
    std::string key(text.substr(open + 1, close - open - 1));
    text.remove_prefix(close + 1);
    if (optional) {
      std::string part;
      if (Fill(object, key, part)) filled += part;
      continue;
    }
    const size_t dot = key.find('.');
    const bool nested = dot != std::string::npos;
    const Json inner = nested ? object.value(key.substr(0, dot), Json::object()) : Json();
    const Json& part = nested ? inner : object;
    if (nested) key.erase(0, dot + 1);
    const size_t colon = key.find(':');
    const std::string value = Cell(part, key.substr(0, colon));
    whole = whole && value != "-";
    filled += colon == std::string::npos
                  ? value
                  : CountCell(part, key.substr(0, colon), key.substr(colon + 1).c_str());
  }
  filled += text;
  return whole;
}

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

Json RowWith(const Json& rows, const char* key, const std::string& value) {
  for (const Json& row : rows) {
    if (row.value(key, Json()) == value) return row;
  }
  return nullptr;
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

std::string Filled(const Json& object, std::string_view text) {
  std::string filled;
  Fill(object, text, filled);
  return filled;
}

std::string HashText(const std::string& hash, bool full) {
  constexpr size_t kDigits = 12;
  return full ? hash : hash.substr(0, kDigits);
}

}  // namespace myograde::server
