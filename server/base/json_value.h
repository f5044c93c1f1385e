// Values that may be missing, as every JSON of the server reads and writes them.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <string_view>

#include <absl/time/time.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// "2026-11-22T19:20:38.000Z".
inline std::string TimeText(absl::Time time) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", time, absl::UTCTimeZone());
}
// The same of ms since 1970-01-01 UTC.
inline std::string TimeText(int64_t ms) { return TimeText(absl::FromUnixMillis(ms)); }

// A text that should be JSON; is_discarded() if it is not.
inline nlohmann::json ParsedText(std::string_view text) {
  return nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
}

// null for "".
inline nlohmann::json TextOrNull(const std::string& text) {
  return text.empty() ? nlohmann::json() : nlohmann::json(text);
}
// null for 0.
inline nlohmann::json IdOrNull(int64_t id) {
  return id == 0 ? nlohmann::json() : nlohmann::json(id);
}

// The value of a key; null if there is none, or no object. A part of `json`.
inline const nlohmann::json& At(const nlohmann::json& json, std::string_view key) {
  static const nlohmann::json kNone;
  if (!json.is_object()) return kNone;
  const auto found = json.find(key);
  return found == json.end() ? kNone : *found;
}
// Its text; "" if it is none.
inline std::string TextAt(const nlohmann::json& json, std::string_view key) {
  const nlohmann::json& value = At(json, key);
  return value.is_string() ? value.get<std::string>() : "";
}

// The JSON pointers at which two objects differ; `at` is that of the two. What one lacks
// counts as an empty object, so what only one has is told key by key; a list is one value.
inline std::set<std::string> DifferingKeys(const nlohmann::json& from, const nlohmann::json& to,
                                           const std::string& at = "") {
  if (from == to) return {};
  if (!from.is_object() || !to.is_object()) return {at};
  nlohmann::json both = from;
  both.update(to);
  std::set<std::string> keys;
  for (const auto& [name, unused] : both.items()) {
    const nlohmann::json none = nlohmann::json::object();
    keys.merge(DifferingKeys(from.value(name, none), to.value(name, none), at + "/" + name));
  }
  return keys;
}

}  // namespace myograde::server
