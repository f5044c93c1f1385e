// Enumerations as the names that the store has for them: tables of pairs of value and name. Internal
// to the store.
#pragma once

#include <optional>
#include <string_view>

namespace myograde::server {

// "" if the table lacks the value.
template <typename Table, typename Value>
std::string_view NameIn(const Table& table, Value value) {
  for (const auto& [known, name] : table) {
    if (known == value) return name;
  }
  return "";
}

template <typename Value, typename Table>
std::optional<Value> ParseIn(const Table& table, std::string_view name) {
  for (const auto& [value, known] : table) {
    if (known == name) return value;
  }
  return std::nullopt;
}

}  // namespace myograde::server
