#include "sim/episode/replay_player.h"

#include <sys/mman.h>

#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/log/packed_log.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/registry.h"

namespace myograde::sim {
namespace {

constexpr absl::Duration kLogDeadline = absl::Minutes(1);

// One episode's comparison, from its reset to its end.
class Comparison {
 public:
  Comparison(const EpisodeLog& log, Environment& environment, EpisodeRecorder* recorder)
      : log_(log),
        environment_(environment),
        recorder_(recorder),
        observation_(static_cast<size_t>(environment.observation_size())) {
    record_.episode = log.header.episode;
    record_.equal = true;
  }

  absl::StatusOr<ReplayRecord> Play(const std::function<void(int64_t)>& on_step) {
    if (log_.header.begun) environment_.Reset(log_.header.seed);
    if (log_.start.has_value()) Begin(*log_.start);
    if (recorder_ != nullptr) recorder_->Begin();
    StepResult result;
    for (int64_t step = 0; step < log_.steps() && record_.equal; ++step) {
      if (result.ended || result.unstable) {
        Differ(step, "steps", absl::StrCat("the episode ended after ", step,
                                           " steps, but its log has ",
                                           log_.steps()));
        break;
      }
      result = Step(step);
      if (result.overflow) {
        return absl::InternalError(absl::StrCat(
            "a contact or constraint buffer was too small in step ", step, " of the replay"));
      }
      if (recorder_ != nullptr && !result.unstable) recorder_->AfterStep();
      on_step(step);
    }
    // What stands at the end of a log that was cut is not known.
    if (record_.equal && log_.end.logged == log_.end.steps) CompareEnd(result);
    return std::move(record_);
  }

 private:
  void Begin(const LogStart& start) {
    environment_.SetConvention(start.convention);
    if (start.parameters.empty()) return;
    if (absl::Status status = environment_.SetParameters(start.parameters); !status.ok()) {
      Differ(-1, "log", absl::StrCat("the log's leg parameters are not valid: ", status.message()));
    }
  }

  StepResult Step(int64_t step) {
    const auto at = static_cast<size_t>(step);
    environment_.Observe(observation_);
    hash_.Update(std::as_bytes(std::span(observation_)));
    if (Shorten(hash_.Finish()) != log_.observations[at]) {
      Differ(step, "observation",
             absl::StrCat("the observation of step ", step, " is not the logged one",
                          step == 0 ? "; the reset had a different outcome" : ""));
    }
    const StepResult result = environment_.Step(log_.action(step));
    states_.Update(std::as_bytes(environment_.state()));
    if (Shorten(states_.Peek()) != log_.states[at]) {
      Differ(step, "state",
             absl::StrCat("the state after step ", step, " is not the logged one, ",
                          record_.equal ? "while the observation before it and all earlier "
                                          "states are"
                                        : "nor is the observation before it"));
    }
    if (record_.equal) ++record_.steps;
    return result;
  }

  void CompareEnd(const StepResult& result) {
    const std::string digest = states_.FinishHex();
    if (digest != log_.end.digest) {
      return Differ(-1, "digest", absl::StrCat("the log has the digest ",
                                               log_.end.digest, " over all states, not ", digest));
    }
    const auto logged = ParseEpisodeEnd(log_.end.end);
    // What the policy ended goes on here.
    const bool by_itself = logged.has_value() && *logged != EpisodeEnd::kGivenUp;
    const std::string unstable(OutcomeName(Outcome::kUnstable));
    if (result.unstable != (log_.end.end == unstable) || result.ended != by_itself) {
      return Differ(-1, "end", absl::StrCat("the log says \"", log_.end.end,
                                            "\", but the episode ended otherwise"));
    }
    if (by_itself && environment_.facts().end != *logged) {
      Differ(-1, "end",
             absl::StrCat("the episode ended by \"",
                          std::string(environment_.facts().end.name()),
                          "\", the log says \"", log_.end.end, "\""));
    }
  }

  void Differ(int64_t step, const char* what, std::string detail) {
    if (record_.equal) record_.step = step;
    record_.equal = false;
    record_.differs.emplace_back(what);
    record_.detail = std::move(detail);
  }

  const EpisodeLog& log_;
  Environment& environment_;
  EpisodeRecorder* const recorder_;
  std::vector<double> observation_;
  Sha256 hash_;
  Sha256 states_;
  ReplayRecord record_;
};

// The record of an episode that can't be played at all.
ReplayRecord Unplayable(int64_t episode, const absl::Status& why) {
  ReplayRecord record;
  record.episode = episode;
  record.differs = {"log"};
  record.detail = std::string(why.message());
  return record;
}

}  // namespace

absl::StatusOr<ReplayRecord> ReplayLog(const EpisodeLog& log, Environment& environment,
                                       const std::function<void(int64_t)>& on_step,
                                       EpisodeRecorder* recorder) {
  return Comparison(log, environment, recorder).Play(on_step);
}

ReplayPlayer::ReplayPlayer(const LeaseOrder& order, Environment& environment, int runner,
                           const Clock& clock, MakeEpisodeRecorder recorders, int trajectory)
    : order_(order),
      environment_(environment),
      runner_(runner),
      clock_(clock),
      recorders_(std::move(recorders)),
      trajectory_(trajectory),
      last_progress_(clock.Monotonic()) {}

absl::Status ReplayPlayer::Play() {
  for (const EpisodeOrder& episode : order_.episodes) {
    ASSIGN_OR_RETURN(ReplayRecord record, PlayEpisode(episode));
    if (!progress_status_.ok()) return progress_status_;
    const std::string line = LeaseRecordToLine(LeaseRecord(std::move(record)));
    RETURN_IF_ERROR(SendSimMessage(runner_, nlohmann::json::parse(line)));
  }
  return SendSimMessage(runner_, {{"type", "done"}});
}

absl::StatusOr<ReplayRecord> ReplayPlayer::PlayEpisode(const EpisodeOrder& episode) {
  absl::StatusOr<EpisodeLog> log = ReadLog(episode);
  if (absl::IsDataLoss(log.status())) return Unplayable(episode.index, log.status());
  if (!log.ok()) return log.status();
  const bool recorded =
      !order_.trajectory.empty() && episode.index == order_.episodes.back().index;
  if (recorded) return PlayAndRecord(*log);
  return ReplayLog(*log, environment_,
                   [&](int64_t step) { Progress(episode.index, step); });
}

absl::StatusOr<ReplayRecord> ReplayPlayer::PlayAndRecord(const EpisodeLog& log) {
  const int64_t index = log.header.episode;
  if (!log.header.begun) {
    return Unplayable(index,
                      absl::DataLossError(
                          "the episode was never begun, because a fault had ended its lease; "
                          "there is nothing to show"));
  }
  ASSIGN_OR_RETURN(const std::unique_ptr<EpisodeRecorder> recorder, recorders_(log));
  absl::StatusOr<ReplayRecord> record =
      ReplayLog(log, environment_, [&](int64_t step) { Progress(index, step); }, recorder.get());
  if (!record.ok() || !record->equal) return record;
  const absl::StatusOr<std::string> bytes = recorder->Finish();
  if (absl::IsResourceExhausted(bytes.status())) return Unplayable(index, bytes.status());
  if (!bytes.ok()) return bytes.status();
  RETURN_IF_ERROR(SendTrajectory(*bytes));
  return record;
}

absl::Status ReplayPlayer::SendTrajectory(const std::string& bytes) {
  if (std::ssize(bytes) > kMostTrajectoryFileBytes) {
    return absl::InternalError("the trajectory does not fit into its memory file");
  }
  // Mapped, as the simulator may write no files.
  void* memory = mmap(nullptr, bytes.size(), PROT_READ | PROT_WRITE, MAP_SHARED, trajectory_, 0);
  if (memory == MAP_FAILED) {
    return absl::InternalError("can't map the memory file for the trajectory");
  }
  std::memcpy(memory, bytes.data(), bytes.size());
  munmap(memory, bytes.size());
  return SendSimMessage(runner_, {{"type", "trajectory"}, {"bytes", bytes.size()}});
}

absl::StatusOr<EpisodeLog> ReplayPlayer::ReadLog(const EpisodeOrder& episode) {
  absl::Status status =
      SendSimMessage(runner_, {{"type", "need_log"}, {"episode", episode.index}});
  if (!status.ok()) return status;
  ASSIGN_OR_RETURN(SimMessage message, ReceiveSimMessage(runner_, kLogDeadline));
  if (message.json["type"] != "log" || !message.fd.valid()) {
    return absl::InternalError("the runner answered need_log without a log");
  }
  ASSIGN_OR_RETURN(std::string bytes, ReadPackedLog(message.fd.get()));
  absl::StatusOr<EpisodeLog> log = ParseEpisodeLog(bytes);
  // A config that does not parse makes the log as worthless as a wrong byte.
  if (!log.ok()) return absl::DataLossError(log.status().message());
  const absl::StatusOr<TrackConfig> track = WithSeeds(order_.track, {episode.seed});
  if (!track.ok()) return track.status();
  if (log->header.episode != episode.index || log->header.seed != episode.seed ||
      log->header.track.hash != track->hash) {
    return absl::DataLossError(
        absl::StrCat("the log is of another episode: episode ", log->header.episode,
                     " with seed ", log->header.seed, " in the config ", log->header.config));
  }
  return log;
}

void ReplayPlayer::Progress(int64_t episode, int64_t step) {
  const absl::Duration now = clock_.Monotonic();
  if (now - last_progress_ < kProgressPeriod || !progress_status_.ok()) return;
  last_progress_ = now;
  progress_status_ =
      SendSimMessage(runner_, {{"type", "progress"}, {"episode", episode}, {"step", step}});
}

}  // namespace myograde::sim
