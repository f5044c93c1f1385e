#include "server/scheduler/host_health.h"

#include <algorithm>
#include <array>

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"

namespace myograde::server {

std::string_view HostStateName(HostHealth::State state) {
  static constexpr std::array<std::string_view, 3> kNames = {"well", "suspected", "paused"};
  return kNames[static_cast<size_t>(state)];
}

void HostHealth::LeaseFaulted(absl::Duration now, const std::string& why) {
  ++faults_;
  last_fault_ = why;
  // A host that has just passed is not tested again at every fault of the same lease.
  if (state_ == State::kWell && faults_ >= limits_.suspect_after && now >= next_test_) {
    state_ = State::kSuspected;
  }
}

bool HostHealth::TestDue(absl::Duration now) const {
  if (testing_ || state_ == State::kWell) return false;
  return state_ == State::kSuspected || now >= next_test_;
}

void HostHealth::TestEnded(absl::Duration now, const std::string& fault) {
  testing_ = false;
  test_fault_ = fault;
  next_test_ = now + limits_.test_every;
  if (fault.empty()) {
    state_ = State::kWell;
    faults_ = 0;
    return;
  }
  if (state_ != State::kPaused) paused_since_ = now;
  state_ = State::kPaused;
}

std::optional<absl::Duration> HostHealth::NextTest() const {
  if (state_ != State::kPaused || testing_) return std::nullopt;
  return next_test_;
}

std::string HostHealth::PauseReason(absl::Duration now) const {
  if (state_ == State::kWell) return "";
  if (state_ == State::kSuspected) {
    return absl::StrCat("the host is being tested after ", Counted(faults_, "fault"),
                        " of the grader in a row, the last one: ", last_fault_);
  }
  const absl::Duration next = std::max(next_test_ - now, absl::ZeroDuration());
  return absl::StrCat("the host is paused, as its self-test failed: ", test_fault_, "; ",
                      testing_ ? std::string("it is being tested again now")
                               : absl::StrCat("it is tested again in ",
                                              absl::FormatDuration(
                                                  absl::Ceil(next, absl::Seconds(1)))),
                      ", and goes on by itself once it passes");
}

}  // namespace myograde::server
