// Plays episodes again from their logs, without a policy, and compares every
// observation and state with the log.
#pragma once

#include <functional>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/log/episode_log.h"
#include "protocol/lease/lease.h"
#include "sim/environment.h"

namespace myograde::sim {

// Plays `log` until its end or the first difference. Where state carries over
// between episodes, the environment must have played those before it in the
// lease. `on_step` hears the number of each step. InternalError if a buffer of
// the simulation was too small.
absl::StatusOr<ReplayRecord> ReplayLog(const EpisodeLog& log, Environment& environment,
                                       const std::function<void(int64_t)>& on_step);

class ReplayPlayer {
 public:
  // `runner`: as LeasePlayer's. References must outlive the player.
  ReplayPlayer(const LeaseOrder& order, Environment& environment, int runner, const Clock& clock);

  // Asks for the log of each episode of the order, plays it, tells what came of
  // it, and says that it is done. A log that can't be played differs in "log".
  // An error is the grader's own.
  absl::Status Play();

 private:
  // DataLossError: the log is damaged, or another episode's.
  absl::StatusOr<EpisodeLog> ReadLog(const EpisodeOrder& episode);
  absl::StatusOr<ReplayRecord> PlayEpisode(const EpisodeOrder& episode);
  void Progress(int64_t episode, int64_t step);

  const LeaseOrder& order_;
  Environment& environment_;
  const int runner_;
  const Clock& clock_;
  absl::Duration last_progress_;
  absl::Status progress_status_;
};

}  // namespace myograde::sim
