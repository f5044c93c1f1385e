// The simulator's side of one policy process: sends frames to its bridge and
// waits for answers, always with a deadline, and turns whatever goes wrong on
// the participant's side into evidence. It never fails: all that a sandbox can
// do is answer or be at fault.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <variant>

#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/tracks/episode_facts.h"
#include "protocol/base/fd.h"
#include "protocol/bridge/frames.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/lease/track_config.h"

namespace myograde::sim {

template <typename T>
using OrFault = std::variant<T, FaultEvidence>;

// What the whole lease has used of its caps before this session.
struct LeaseUse {
  absl::Duration cpu;
  absl::Duration started;  // Clock::Monotonic at the lease's start
};

class PolicySession {
 public:
  // `socket`: SOCK_SEQPACKET to the bridge. `cpu` may be null where CPU time
  // is not measured; then the wall caps alone hold. `on_wait` is called many
  // times a second while an answer is waited for, `measure` before an answer
  // that took its time is judged: it has the CPU time read anew. All references
  // must outlive the session. The start-up budget begins to run now.
  PolicySession(Fd socket, const Budgets& budgets, CpuPage* cpu, const Clock& clock,
                LeaseUse use, std::function<void()> on_wait, std::function<void()> measure);

  // Waits for the policy's hello, within the start-up budget.
  OrFault<HelloFrame> AwaitHello();

  // Sends a message that needs no answer.
  std::optional<FaultEvidence> Tell(const PublishFrame& frame);

  // Starts an episode: a new bank of overtime. The first is part of the
  // start-up budget, later ones have a step's.
  OrFault<ReadyFrame> Start(const PublishFrame& start);

  // What answers an observation.
  using StepAnswer = std::variant<ActionFrame, GiveUpFrame, FaultEvidence>;

  // Asks for one action and waits for it: frame.action_size finite values, or that the
  // policy gives up.
  StepAnswer Ask(const PublishFrame& observation);

  // CPU time of this session so far, as last measured.
  absl::Duration cpu_used() const;

 private:
  struct Waiting;
  OrFault<BridgeFrame> Await(const Waiting& waiting);
  OrFault<BridgeFrame> Receive(const Waiting& waiting, bool& again);
  std::optional<FaultEvidence> OverBudget(const Waiting& waiting) const;
  std::optional<FaultEvidence> OverStartUp() const;
  std::optional<FaultEvidence> OverLease(int64_t step) const;
  void Charge(const Waiting& waiting);
  Waiting BeginStep(int64_t step) const;
  FaultEvidence FromBridge(const FaultFrame& frame, int64_t step) const;

  Fd socket_;
  const Budgets& budgets_;
  CpuPage* cpu_;
  const Clock& clock_;
  const LeaseUse use_;
  const std::function<void()> on_wait_;
  const std::function<void()> measure_;
  const absl::Duration began_;
  const uint64_t cpu_at_start_ns_;
  const uint64_t idle_at_start_ns_;
  absl::Duration overtime_cpu_;   // left in the episode's bank
  absl::Duration overtime_wall_;
  bool first_episode_ = true;
};

}  // namespace myograde::sim
