#include "sim/film/recording.h"

#include <fcntl.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/log/packed_log.h"
#include "sim/episode/replay_player.h"

namespace myograde::sim {
namespace {

absl::StatusOr<EpisodeLog> ReadRecordedLog(const std::string& name, int fd,
                                           const TrackConfig& track) {
  absl::StatusOr<std::string> bytes = ReadPackedLog(fd);
  if (!bytes.ok()) return absl::DataLossError(absl::StrCat(name, ": ", bytes.status().message()));
  absl::StatusOr<EpisodeLog> log = ParseEpisodeLog(*bytes);
  if (!log.ok()) return absl::DataLossError(absl::StrCat(name, ": ", log.status().message()));
  const absl::StatusOr<TrackConfig> expected = WithSeeds(track, {log->header.seed});
  if (!expected.ok() || expected->hash != log->header.track.hash) {
    return absl::DataLossError(absl::StrCat(
        name, ": the log is of another track config, ", log->header.track.id, " in the profile ",
        log->header.track.profile));
  }
  return log;
}

absl::Status CheckPlayed(const absl::StatusOr<ReplayRecord>& record) {
  if (!record.ok()) return record.status();
  if (record->equal) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("episode ", record->episode,
                                          " does not play as it was recorded: ", record->detail));
}

}  // namespace

absl::StatusOr<Recording> Recording::Open(const std::vector<std::string>& logs) {
  Recording recording;
  recording.names_ = logs;
  for (const std::string& path : logs) {
    recording.files_.emplace_back(open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (recording.files_.back().valid()) continue;
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", std::strerror(errno)));
  }
  return recording;
}

absl::Status Recording::Read(const TrackConfig& track) {
  for (size_t i = 0; i < files_.size(); ++i) {
    absl::StatusOr<EpisodeLog> log = ReadRecordedLog(names_[i], files_[i].get(), track);
    if (!log.ok()) return log.status();
    logs_.push_back(*std::move(log));
  }
  files_.clear();
  if (log().steps() > 0) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("episode ", log().header.episode,
                                          " has no step to show: it ended by \"", log().end.end,
                                          "\" before the first"));
}

absl::Status Recording::Play(Environment& environment,
                             const std::function<absl::Status(int64_t)>& on_step) const {
  for (size_t i = 0; i + 1 < logs_.size(); ++i) {
    const absl::Status played = CheckPlayed(ReplayLog(logs_[i], environment, [](int64_t) {}));
    if (!played.ok()) return played;
  }
  absl::Status shown;
  const auto record = ReplayLog(log(), environment, [&](int64_t step) {
    if (shown.ok()) shown = on_step(step + 1);
  });
  return shown.ok() ? CheckPlayed(record) : shown;
}

}  // namespace myograde::sim
