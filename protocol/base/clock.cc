#include "protocol/base/clock.h"

#include <chrono>

#include <absl/time/clock.h>

namespace myograde {
namespace {

class HostClock : public Clock {
 public:
  absl::Duration Monotonic() const override {
    return absl::FromChrono(std::chrono::steady_clock::now().time_since_epoch());
  }
  absl::Time Now() const override { return absl::Now(); }
};

}  // namespace

const Clock& SystemClock() {
  // Never destroyed, as threads that end with the process may still use it.
  static const HostClock& clock = *new HostClock;
  return clock;
}

}  // namespace myograde
