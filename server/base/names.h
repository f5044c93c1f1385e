// Names that are shown on boards: of teams and of policies. Unicode data on characters and
// look-alikes comes from ICU.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde::server {

inline constexpr size_t kMaxNameBytes = 64;

// The form in which a new name is stored: normalised (NFKC), runs of spaces collapsed, 1 to
// kMaxNameBytes bytes, visible characters only. Idempotent. InvalidArgumentError: one sentence with
// `what`, the problem, and the character as U+XXXX.
absl::StatusOr<std::string> CleanName(std::string_view name, std::string_view what);

// The looks of a name: in lower case, without spaces and with look-alike characters unified. Two names can be
// mistaken for each other if they have a look in common.
std::set<std::string> ConfusableSkeletons(std::string_view name);

// Changes whenever ConfusableSkeletons may give different results.
std::string SkeletonVersion();

}  // namespace myograde::server
