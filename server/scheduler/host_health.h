// Whether this host may play leases. Consecutive grader faults, with no lease played well in
// between, put the host under suspicion: nothing starts and a self-test runs. If it passes, the
// leases were at fault and play goes on; if it fails, the host is paused and tested again every
// `test_every` until it passes. State and decisions only, as in scheduler.h.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <absl/time/time.h>

namespace myograde::server {

struct HostLimits {
  int suspect_after = 2;                             // consecutive faults
  absl::Duration test_every = absl::Minutes(3);      // from the end of one test to the next
};

class HostHealth {
 public:
  // kWell: leases start. kSuspected: a test is due or running, and nothing starts. kPaused: the
  // last test failed.
  enum class State { kWell, kSuspected, kPaused };

  explicit HostHealth(HostLimits limits) : limits_(limits) {}

  // A lease ended well.
  void LeaseDone() { faults_ = 0; }
  // A lease ended with a grader fault.
  void LeaseFaulted(absl::Duration now, const std::string& why);

  // Whether a test should start now.
  bool TestDue(absl::Duration now) const;
  void TestBegins() { testing_ = true; }
  // `fault`: "" if the test passed, else one sentence.
  void TestEnded(absl::Duration now, const std::string& fault);

  bool may_start() const { return state_ == State::kWell; }
  State state() const { return state_; }
  // When to poll again even if nothing happens.
  std::optional<absl::Duration> NextTest() const;
  // Why nothing starts, for people; "" if kWell.
  std::string PauseReason(absl::Duration now) const;
  // When the host was paused. Valid only if kPaused.
  absl::Duration paused_since() const { return paused_since_; }

 private:
  HostLimits limits_;
  State state_ = State::kWell;
  int faults_ = 0;                 // consecutive
  std::string last_fault_;         // of a lease
  std::string test_fault_;         // of the last test
  bool testing_ = false;
  absl::Duration next_test_ = -absl::InfiniteDuration();
  absl::Duration paused_since_;
};

std::string_view HostStateName(HostHealth::State state);  // "well", "suspected", "paused"

}  // namespace myograde::server
