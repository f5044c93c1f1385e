// Hands an error on to the caller.
#pragma once

#include <utility>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

// Returns the Status of the expression from this function unless it is OK.
#define RETURN_IF_ERROR(...) MYOGRADE_RETURN_IF_ERROR(MYOGRADE_UNIQUE(status), __VA_ARGS__)

// ASSIGN_OR_RETURN(const Track track, FindTrack(name)): returns the Status of the StatusOr from this
// function unless it is OK, and otherwise moves its value into what is declared or named first. It is
// two statements, so it is never the body of an `if` without braces. A type with a comma is `auto`.
#define ASSIGN_OR_RETURN(declared, ...) \
  MYOGRADE_ASSIGN_OR_RETURN(MYOGRADE_UNIQUE(result), declared, __VA_ARGS__)

#define MYOGRADE_RETURN_IF_ERROR(status, ...) \
  if (absl::Status status = (__VA_ARGS__); !status.ok()) return status

#define MYOGRADE_ASSIGN_OR_RETURN(result, declared, ...) \
  auto result = (__VA_ARGS__);                           \
  if (!result.ok()) return std::move(result).status();   \
  declared = *std::move(result)

// A name that no other use of a macro has, one within another's argument included.
#define MYOGRADE_UNIQUE(name) MYOGRADE_JOIN(name, __COUNTER__)
#define MYOGRADE_JOIN(name, number) MYOGRADE_JOIN_EXPANDED(name, number)
#define MYOGRADE_JOIN_EXPANDED(name, number) name##_##number##_
