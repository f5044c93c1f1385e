// Names that others read on boards: of teams and of policies. What Unicode says of
// characters and of look-alikes comes from ICU.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde::server {

inline constexpr size_t kMaxNameBytes = 64;

// The form in which a new name is kept: normalised (NFKC), with one space where
// there were several. 1 to kMaxNameBytes bytes, each character of which is seen.
// InvalidArgumentError: `what` and what is wrong with it in one sentence, with the
// character as U+XXXX. What it returns it returns unchanged when it is given it.
absl::StatusOr<std::string> CleanName(std::string_view name, std::string_view what);

// What a name looks like, in lower case and with its look-alikes made equal. Two
// names may be taken for one another if they have one of these in common.
std::set<std::string> LooksOf(std::string_view name);

// Another one if LooksOf may give others than before.
std::string LooksVersion();

}  // namespace myograde::server
