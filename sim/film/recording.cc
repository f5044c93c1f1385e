#include "sim/film/recording.h"

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
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
    ASSIGN_OR_RETURN(EpisodeLog log, ReadRecordedLog(names_[i], files_[i].get(), track));
    logs_.push_back(std::move(log));
  }
  files_.clear();
  return absl::OkStatus();
}

bool Recording::BeginsWith(const std::vector<std::string>& logs) const {
  return logs.size() <= names_.size() && std::equal(logs.begin(), logs.end(), names_.begin());
}

absl::Status Recording::Play(Environment& environment,
                             const std::function<absl::Status(size_t, int64_t)>& on_step) const {
  for (size_t i = 0; i < logs_.size(); ++i) {
    absl::Status shown;
    const auto record = ReplayLog(logs_[i], environment, [&](int64_t step) {
      if (shown.ok()) shown = on_step(i, step + 1);
    });
    if (!shown.ok()) return shown;
    RETURN_IF_ERROR(CheckPlayed(record));
  }
  return absl::OkStatus();
}

}  // namespace myograde::sim
