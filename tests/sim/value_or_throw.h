#pragma once

#include <stdexcept>
#include <utility>

#include <absl/status/statusor.h>

namespace myograde::sim {

// For what a test can't go on without.
template <typename T>
T ValueOrThrow(absl::StatusOr<T> value) {
  if (!value.ok()) throw std::runtime_error(value.status().ToString());
  return *std::move(value);
}

}  // namespace myograde::sim
