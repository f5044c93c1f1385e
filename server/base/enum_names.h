// Enumerations by name: arrays of the names of 0, 1 and so on.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <optional>
#include <string_view>

namespace myograde::server {

template <typename Names, typename Value>
std::string_view NameIn(const Names& names, Value value) {
  return names[static_cast<size_t>(value)];
}
template <typename Value, typename Names>
std::optional<Value> ParseIn(const Names& names, std::string_view name) {
  const auto found = std::find(std::begin(names), std::end(names), name);
  if (found == std::end(names)) return std::nullopt;
  return static_cast<Value>(found - std::begin(names));
}

}  // namespace myograde::server
