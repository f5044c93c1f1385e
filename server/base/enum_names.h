// Enumerations by name. Beside each one stand the names of its values 0, 1 and so on:
//
//   template <>
//   inline constexpr std::string_view kNamesOf<Colour>[] = {"red", "green"};
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <optional>
#include <string_view>

namespace myograde::server {

template <typename Value>
inline constexpr std::nullptr_t kNamesOf = nullptr;

template <typename Value>
std::string_view EnumName(Value value) {
  return kNamesOf<Value>[static_cast<size_t>(value)];
}
template <typename Value>
std::optional<Value> ParseEnum(std::string_view name) {
  const auto found = std::find(std::begin(kNamesOf<Value>), std::end(kNamesOf<Value>), name);
  if (found == std::end(kNamesOf<Value>)) return std::nullopt;
  return static_cast<Value>(found - std::begin(kNamesOf<Value>));
}

}  // namespace myograde::server
