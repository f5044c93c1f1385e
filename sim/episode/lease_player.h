// Plays the episodes of one lease: asks the runner for sandboxes, steps the
// environment with the policy's answers, and records the facts.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/lease/lease.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/sim_channel.h"
#include "sim/environment.h"
#include "sim/episode/digests.h"
#include "sim/episode/log_writer.h"
#include "sim/episode/messages.h"
#include "sim/episode/policy_session.h"

namespace myograde::sim {

class LeasePlayer {
 public:
  // `runner`: the SOCK_SEQPACKET channel of protocol/lease/sim_channel.h, not owned.
  // `cpu`: null where CPU time is not measured. `max_steps` is told to the
  // policy. `log`: where the episodes' logs go, null if none are kept.
  // References must outlive the player.
  LeasePlayer(const LeaseOrder& order, Environment& environment, int64_t max_steps, int runner,
              CpuPage* cpu, const Clock& clock, LogWriter* log = nullptr);

  // Records every episode of the order and says that it is done. An error is
  // the grader's own: the runner is gone or silent, a ruling blames the
  // grader, a buffer of the simulation was too small. Episodes recorded until
  // then stand.
  absl::Status Play();

 private:
  // How an episode went: played to its end, ended by a fault, or (a status)
  // by the grader itself.
  using Result = absl::StatusOr<std::optional<FaultEvidence>>;

  absl::Status PlayEpisode(const EpisodeOrder& episode);
  Result Run(const EpisodeOrder& episode);
  Result RunSteps();
  Result StartPolicy(uint64_t policy_seed);
  Result EnsurePolicy();
  Result Greet();
  std::optional<FaultEvidence> StartEpisode(uint64_t policy_seed);
  // Adds what the policy uploaded to `all`, and has the environment take that.
  absl::Status TakeParameters(const ParametersText& uploaded, nlohmann::json& all);
  absl::StatusOr<FaultEvidence> Rule(const FaultEvidence& seen);
  void EndSession();
  void BeginLog(const EpisodeOrder& episode);
  absl::Status EndLog(EpisodeFacts& facts);
  absl::Status Record(const EpisodeOrder& episode, const std::optional<FaultEvidence>& fault);
  // Without the policy's start, which is not an episode's.
  void TellTimes(EpisodeFacts& facts);
  // Sends `question` and waits for the answer, telling of progress meanwhile.
  absl::StatusOr<SimMessage> AskRunner(const nlohmann::json& question, absl::Duration limit);
  void Progress();
  void Measure();

  const LeaseOrder& order_;
  Environment& environment_;
  const int64_t max_steps_;
  const int runner_;
  CpuPage* const cpu_;
  const Clock& clock_;
  LogWriter* const log_;
  const int extra_size_;  // entries of an observation after the graded ones

  Messages messages_;
  EpisodeDigests digests_;
  Sha256 observation_digest_;
  std::optional<PolicySession> session_;
  nlohmann::json hello_parameters_ = nlohmann::json::object();
  ActionConvention convention_ = ActionConvention::kNormalized;
  int64_t wire_episode_ = 0;  // place in the session's run
  int64_t restarts_left_;
  LeaseUse use_;
  absl::Duration lease_cpu_;  // of all sessions that ended

  // Of the episode being played.
  int64_t index_ = 0;
  int64_t step_ = 0;
  bool reset_ = false;
  bool given_up_ = false;
  absl::Duration episode_wall_start_;
  absl::Duration episode_cpu_start_;
  absl::Duration startup_wall_;  // of the policy's start in this episode, if there was one
  absl::Duration startup_cpu_;

  bool refused_ = false;  // the runner gives no policy any more; the evidence is its ruling

  // Once set, it is what the rest of the lease gets.
  std::optional<FaultEvidence> last_fault_;
  absl::Duration last_progress_;
  absl::Status progress_status_;
};

}  // namespace myograde::sim
