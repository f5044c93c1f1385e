// How many connections of each peer may begin in a while: each costs a handshake, which is far more
// work for the server than for whoever asks for it.
#pragma once

#include <absl/time/time.h>

#include <algorithm>
#include <map>
#include <string>

namespace myograde::server {

// For one thread. Times are monotonic.
class ArrivalRate {
 public:
  // `per_s` in the long run, and `burst` at once.
  ArrivalRate(double per_s, double burst) : per_s_(per_s), burst_(burst) {}

  // Whether one more of `key` may begin at `now`.
  bool Allows(const std::string& key, absl::Duration now) const {
    const auto it = recent_.find(key);
    return it == recent_.end() || LeftOf(it->second, now) + 1 <= burst_;
  }
  // One begins.
  void Count(const std::string& key, absl::Duration now) {
    Recent& recent = recent_[key];
    recent = {LeftOf(recent, now) + 1, now};
  }
  // Forgets those who count no more, which keeps this small.
  void LookAtClocks(absl::Duration now) {
    std::erase_if(recent_, [&](const auto& entry) { return LeftOf(entry.second, now) <= 0; });
  }

 private:
  struct Recent {
    double count = 0;
    absl::Duration at;
  };
  double LeftOf(const Recent& recent, absl::Duration now) const {
    return std::max(0.0, recent.count - per_s_ * absl::ToDoubleSeconds(now - recent.at));
  }

  const double per_s_;
  const double burst_;
  std::map<std::string, Recent> recent_;  // by the peer's key
};

}  // namespace myograde::server
