// When a webhook that did not take an event is tried again. Pure.
#pragma once

#include <cstdint>

#include <absl/time/time.h>

namespace myograde::server {

inline constexpr absl::Duration kFirstRetry = absl::Seconds(5);
inline constexpr absl::Duration kLongestRetry = absl::Minutes(15);

// The wait after the `attempts`-th attempt failed: doubled each time from kFirstRetry up to
// kLongestRetry, and of that the half to all of it, by `random` in [0, 1), so that daemons that
// lost the same receiver do not come back together. REQUIRES: attempts >= 1.
absl::Duration DelayAfter(int64_t attempts, double random);

}  // namespace myograde::server
