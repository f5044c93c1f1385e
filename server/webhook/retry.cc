#include "server/webhook/retry.h"

#include <algorithm>

namespace myograde::server {

absl::Duration DelayAfter(int64_t attempts, double random) {
  constexpr int64_t kMostDoublings = 20;  // far beyond the longest
  const int64_t doublings = std::clamp<int64_t>(attempts - 1, 0, kMostDoublings);
  const absl::Duration whole =
      std::min(kFirstRetry * static_cast<double>(int64_t{1} << doublings), kLongestRetry);
  return whole * (0.5 + random / 2);
}

}  // namespace myograde::server
