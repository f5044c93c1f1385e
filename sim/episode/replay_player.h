// Plays episodes again from their logs, without a policy, and compares every
// observation and state with the log.
#pragma once

#include <functional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/log/episode_log.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "sim/environment.h"
#include "sim/episode/episode_recorder.h"

namespace myograde::sim {

// Plays `log` until its end or the first difference. Where state carries over
// between episodes, the environment must have played those before it in the
// lease. `on_step` hears the number of each step, and `recorder`, if there is
// one, looks on. InternalError if a buffer of the simulation was too small.
absl::StatusOr<ReplayRecord> ReplayLog(const EpisodeLog& log, Environment& environment,
                                       const std::function<void(int64_t)>& on_step,
                                       EpisodeRecorder* recorder = nullptr);

class ReplayPlayer {
 public:
  // `runner`: as LeasePlayer's. `recorders` makes the recorder of the last episode if the order asks
  // for a trajectory, whose bytes go to the descriptor `trajectory`. References must outlive the player.
  ReplayPlayer(const LeaseOrder& order, Environment& environment, int runner, const Clock& clock,
               MakeEpisodeRecorder recorders = nullptr, int trajectory = kSimTrajectoryFd);

  // Asks for the log of each episode of the order, plays it, reports the result of
  // it, and says that it is done. A log that can't be played differs in "log".
  // An error is the grader's own.
  absl::Status Play();

 private:
  // DataLossError: the log is damaged, or another episode's.
  absl::StatusOr<EpisodeLog> ReadLog(const EpisodeOrder& episode);
  absl::StatusOr<ReplayRecord> PlayEpisode(const EpisodeOrder& episode);
  // The record of an episode that is recorded as well; one that can't be differs in "log".
  absl::StatusOr<ReplayRecord> PlayAndRecord(const EpisodeLog& log);
  absl::Status SendTrajectory(const std::string& bytes);
  void Progress(int64_t episode, int64_t step);

  const LeaseOrder& order_;
  Environment& environment_;
  const int runner_;
  const Clock& clock_;
  const MakeEpisodeRecorder recorders_;
  const int trajectory_;
  absl::Duration last_progress_;
  absl::Status progress_status_;
};

}  // namespace myograde::sim
