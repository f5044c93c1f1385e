#include "sim/episode/policy_session.h"

#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "sim/episode/messages.h"

namespace myograde::sim {
namespace {

// How long one receive sleeps before the budgets are looked at again.
constexpr timeval kSlice = {0, 20000};
// An answer in less time can't have used so much CPU time that it were worth
// the price of a reading.
constexpr absl::Duration kQuickAnswer = absl::Milliseconds(10);

FaultEvidence Evidence(Outcome outcome, int64_t step, std::string detail) {
  FaultEvidence evidence;
  evidence.outcome = outcome;
  evidence.step = step;
  evidence.detail = std::move(detail);
  return evidence;
}

FaultEvidence BrokenLimit(Outcome outcome, const char* limit, double limit_value, double value,
                          int64_t step, std::string detail) {
  FaultEvidence evidence = Evidence(outcome, step, std::move(detail));
  evidence.limit = limit;
  evidence.limit_value = limit_value;
  evidence.value = value;
  return evidence;
}

FaultEvidence OutOfTurn(int64_t step) {
  return Evidence(Outcome::kProtocol, step,
                  "the bridge in the participant's sandbox sent an unexpected answer");
}

std::string NameOf(int64_t step) {
  return step < 0 ? "the start of an episode" : absl::StrCat("step ", step);
}

}  // namespace

// One wait for an answer and what it may use.
struct PolicySession::Waiting {
  int64_t step = -1;
  bool start_up = false;
  absl::Duration wall_start;
  uint64_t cpu_start_ns = 0;
};

PolicySession::PolicySession(Fd socket, const Budgets& budgets, CpuPage* cpu,
                             const Clock& clock, LeaseUse use, std::function<void()> on_wait,
                             std::function<void()> measure)
    : socket_(std::move(socket)),
      budgets_(budgets),
      cpu_(cpu),
      clock_(clock),
      use_(use),
      on_wait_(std::move(on_wait)),
      measure_(std::move(measure)),
      began_(clock.Monotonic()),
      cpu_at_start_ns_(cpu == nullptr ? 0 : cpu->cpu_ns.load(std::memory_order_relaxed)),
      idle_at_start_ns_(cpu == nullptr ? 0 : cpu->start_idle_ns.load()) {
  setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &kSlice, sizeof(kSlice));
}

absl::Duration PolicySession::cpu_used() const {
  if (cpu_ == nullptr) return absl::ZeroDuration();
  // The page may have started afresh with this sandbox after we looked.
  const uint64_t now = cpu_->cpu_ns.load(std::memory_order_relaxed);
  return absl::Nanoseconds(now >= cpu_at_start_ns_ ? now - cpu_at_start_ns_ : now);
}

PolicySession::Waiting PolicySession::BeginStep(int64_t step) const {
  Waiting waiting;
  waiting.step = step;
  waiting.wall_start = clock_.Monotonic();
  waiting.cpu_start_ns = static_cast<uint64_t>(absl::ToInt64Nanoseconds(cpu_used()));
  return waiting;
}

OrFault<HelloFrame> PolicySession::AwaitHello() {
  Waiting waiting;
  waiting.start_up = true;
  OrFault<BridgeFrame> answer = Await(waiting);
  if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::move(*fault);
  const auto* hello = std::get_if<HelloFrame>(&std::get<BridgeFrame>(answer));
  if (hello == nullptr) return OutOfTurn(-1);
  return *hello;
}

std::optional<FaultEvidence> PolicySession::Tell(const PublishFrame& frame) {
  const std::span<const std::byte> bytes = FrameBytes(frame);
  ssize_t sent;
  do {
    sent = send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  } while (sent < 0 && errno == EINTR);
  if (sent == static_cast<ssize_t>(bytes.size())) return std::nullopt;
  return Evidence(Outcome::kCrash, frame.step,
                  errno == EAGAIN
                      ? "the bridge in the participant's sandbox stopped reading"
                      : "the participant's sandbox ended");
}

OrFault<ReadyFrame> PolicySession::Start(const PublishFrame& start) {
  overtime_cpu_ = absl::Seconds(budgets_.overtime_s);
  overtime_wall_ = budgets_.wall_factor * overtime_cpu_;
  Waiting waiting = BeginStep(-1);
  waiting.start_up = std::exchange(first_episode_, false);
  if (auto fault = Tell(start); fault.has_value()) return *std::move(fault);
  OrFault<BridgeFrame> answer = Await(waiting);
  if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::move(*fault);
  const auto* ready = std::get_if<ReadyFrame>(&std::get<BridgeFrame>(answer));
  if (ready == nullptr || ready->episode != start.episode) return OutOfTurn(-1);
  return *ready;
}

PolicySession::StepAnswer PolicySession::Ask(const PublishFrame& observation) {
  const Waiting waiting = BeginStep(observation.step);
  if (auto fault = Tell(observation); fault.has_value()) return *std::move(fault);
  OrFault<BridgeFrame> answer = Await(waiting);
  if (auto* fault = std::get_if<FaultEvidence>(&answer)) return std::move(*fault);
  const auto answers = [&](const auto& frame) {
    return frame.episode == observation.episode && frame.step == observation.step;
  };
  const BridgeFrame& frame = std::get<BridgeFrame>(answer);
  if (const auto* action = std::get_if<ActionFrame>(&frame);
      action != nullptr && answers(*action) && action->size == observation.action_size) {
    return *action;
  }
  if (const auto* give_up = std::get_if<GiveUpFrame>(&frame);
      give_up != nullptr && answers(*give_up)) {
    return *give_up;
  }
  return OutOfTurn(observation.step);
}

OrFault<BridgeFrame> PolicySession::Await(const Waiting& waiting) {
  while (true) {
    bool again = false;
    OrFault<BridgeFrame> answer = Receive(waiting, again);
    // What it used is its own: neither the next step's nor, by an old reading, nobody's.
    if (!again && !waiting.start_up &&
        clock_.Monotonic() - waiting.wall_start >= kQuickAnswer) {
      measure_();
    }
    // An answer that took more than its budget comes too late even if it came
    // between two looks at the clock.
    if (again || std::holds_alternative<BridgeFrame>(answer)) {
      if (auto fault = OverBudget(waiting); fault.has_value()) return *std::move(fault);
      if (auto fault = OverLease(waiting.step); fault.has_value()) return *std::move(fault);
    }
    if (!again) {
      Charge(waiting);
      return answer;
    }
    on_wait_();
  }
}

OrFault<BridgeFrame> PolicySession::Receive(const Waiting& waiting, bool& again) {
  alignas(8) std::array<std::byte, sizeof(HelloFrame) + 1> buffer;  // the largest, and one more
  static_assert(sizeof(HelloFrame) >= sizeof(ReadyFrame) &&
                sizeof(HelloFrame) >= sizeof(ActionFrame) &&
                sizeof(HelloFrame) >= sizeof(GiveUpFrame) &&
                sizeof(HelloFrame) >= sizeof(FaultFrame));
  // Whoever starts up may wait for its files, so the two are counted apart.
  std::atomic<uint64_t>* asked = nullptr;
  if (cpu_ != nullptr) asked = waiting.start_up ? &cpu_->starts : &cpu_->waits;
  if (asked != nullptr) asked->fetch_add(1);
  const ssize_t size = recv(socket_.get(), buffer.data(), buffer.size(), 0);
  if (asked != nullptr) asked->fetch_add(1);
  if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) {
    again = true;
    return FaultEvidence{};
  }
  if (size <= 0) {
    return Evidence(Outcome::kCrash, waiting.step,
                    "the participant's sandbox ended before it answered");
  }
  absl::StatusOr<BridgeFrame> frame =
      ParseBridgeFrame({buffer.data(), static_cast<size_t>(size)});
  if (!frame.ok()) {
    return Evidence(Outcome::kProtocol, waiting.step, std::string(frame.status().message()));
  }
  if (const auto* fault = std::get_if<FaultFrame>(&*frame)) {
    return FromBridge(*fault, waiting.step);
  }
  return *std::move(frame);
}

FaultEvidence PolicySession::FromBridge(const FaultFrame& frame, int64_t step) const {
  FaultEvidence evidence = Evidence(Outcome::kProtocol, step, frame.detail);
  switch (frame.fault) {
    case BridgeFault::kProtocol:
      if (frame.value > 0) {
        evidence.limit = "wrong_answers";
        evidence.limit_value = static_cast<double>(budgets_.wrong_answers);
      }
      break;
    case BridgeFault::kStrayLimit:
      evidence.limit = "stray_messages";
      evidence.limit_value = static_cast<double>(budgets_.stray_messages);
      break;
    case BridgeFault::kPolicyExit:
    case BridgeFault::kStartFailed:
      evidence.outcome = Outcome::kCrash;
      break;
  }
  evidence.value = static_cast<double>(frame.value);
  return evidence;
}

// Others' load decides nothing: a wait for a processor or a disk is not the policy's time.
std::optional<FaultEvidence> PolicySession::OverStartUp() const {
  const double wall = absl::ToDoubleSeconds(clock_.Monotonic() - began_);
  if (wall > budgets_.startup_wall_s) {
    return BrokenLimit(Outcome::kInitTimeout, "startup_wall_s", budgets_.startup_wall_s, wall, -1,
                       absl::StrFormat("the policy was not ready for its first episode %g s "
                                       "after its start, with all waiting for processors and "
                                       "disks; say hello and be ready sooner",
                                       budgets_.startup_wall_s));
  }
  double used = wall;
  if (cpu_ != nullptr) {
    const double idle =
        1e-9 * static_cast<double>(cpu_->start_idle_ns.load() - idle_at_start_ns_);
    // On several processors it may use more than one second of them in a second.
    used = std::min(wall, absl::ToDoubleSeconds(cpu_used()) + idle);
  }
  if (used <= budgets_.startup_s) return std::nullopt;
  return BrokenLimit(Outcome::kInitTimeout, "startup_s", budgets_.startup_s, used, -1,
                     absl::StrFormat("the policy was not ready for its first episode after %g s "
                                     "in which it ran or wanted no processor; say hello and be "
                                     "ready sooner",
                                     budgets_.startup_s));
}

std::optional<FaultEvidence> PolicySession::OverBudget(const Waiting& waiting) const {
  if (waiting.start_up) return OverStartUp();
  const absl::Duration cpu = cpu_used() - absl::Nanoseconds(waiting.cpu_start_ns);
  if (cpu > absl::Seconds(budgets_.step_s) + overtime_cpu_) {
    return BrokenLimit(
        Outcome::kStepTimeout, "step_s", budgets_.step_s, absl::ToDoubleSeconds(cpu),
        waiting.step,
        absl::StrFormat("%s took %.3g s of CPU time; it may take %g s, and the %.3g s that were "
                        "left in the episode's bank of overtime are used up",
                        NameOf(waiting.step), absl::ToDoubleSeconds(cpu), budgets_.step_s,
                        absl::ToDoubleSeconds(overtime_cpu_)));
  }
  const absl::Duration wall = clock_.Monotonic() - waiting.wall_start;
  const absl::Duration wall_limit =
      budgets_.wall_factor * absl::Seconds(budgets_.step_s) + overtime_wall_;
  if (wall <= wall_limit) return std::nullopt;
  return BrokenLimit(
      Outcome::kStepTimeout, "wall_factor", budgets_.wall_factor,
      budgets_.wall_factor * absl::FDivDuration(wall, wall_limit), waiting.step,
      absl::StrFormat("no answer to %s for %.3g s of wall time; the policy slept, or never heard "
                      "the question",
                      NameOf(waiting.step), absl::ToDoubleSeconds(wall)));
}

std::optional<FaultEvidence> PolicySession::OverLease(int64_t step) const {
  const double cpu = absl::ToDoubleSeconds(use_.cpu + cpu_used());
  if (cpu > budgets_.lease_cpu_s) {
    return BrokenLimit(Outcome::kCpuLimit, "lease_cpu_s", budgets_.lease_cpu_s, cpu, step,
                       absl::StrFormat("the policy used %.4g s of CPU time in its block of "
                                       "episodes, which allows %g s",
                                       cpu, budgets_.lease_cpu_s));
  }
  const double wall = absl::ToDoubleSeconds(clock_.Monotonic() - use_.started);
  const double idle =
      cpu_ == nullptr ? 0 : 1e-9 * static_cast<double>(cpu_->idle_ns.load());
  if (idle > budgets_.lease_idle_s) {
    return BrokenLimit(Outcome::kWallTimeout, "lease_idle_s", budgets_.lease_idle_s, idle, step,
                       absl::StrFormat("the policy was idle for %.4g s of its lease, which allows "
                                       "%g s: it was asked and wanted no processor",
                                       idle, budgets_.lease_idle_s));
  }
  if (wall <= budgets_.lease_wall_s) return std::nullopt;
  return BrokenLimit(Outcome::kWallTimeout, "lease_wall_s", budgets_.lease_wall_s, wall, step,
                     absl::StrFormat("the block of episodes took %.4g s of wall time, which "
                                     "allows %g s",
                                     wall, budgets_.lease_wall_s));
}

void PolicySession::Charge(const Waiting& waiting) {
  if (waiting.start_up) return;
  const absl::Duration step = absl::Seconds(budgets_.step_s);
  const absl::Duration cpu = cpu_used() - absl::Nanoseconds(waiting.cpu_start_ns);
  const absl::Duration wall = clock_.Monotonic() - waiting.wall_start;
  overtime_cpu_ -= std::max(cpu - step, absl::ZeroDuration());
  overtime_wall_ -= std::max(wall - budgets_.wall_factor * step, absl::ZeroDuration());
}

}  // namespace myograde::sim
