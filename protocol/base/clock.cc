#include "protocol/base/clock.h"

#include <chrono>
#include <condition_variable>
#include <mutex>

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

bool WaitForStop(const std::stop_token& stop, absl::Duration at_most) {
  std::mutex mutex;
  std::condition_variable_any stopped;  // by the token alone
  std::unique_lock lock(mutex);
  stopped.wait_for(lock, stop, absl::ToChronoNanoseconds(at_most), [] { return false; });
  return stop.stop_requested();
}

}  // namespace myograde
