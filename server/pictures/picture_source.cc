#include "server/pictures/picture_source.h"

#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/grading/episode_order.h"
#include "server/grading/stored_track.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/proof/replay_run.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

constexpr int64_t kMostEnded = 20;
constexpr size_t kBuildDigits = 16;

// "" if it has none, or can't be read.
std::string LogOf(const EpisodeRow& row) {
  const nlohmann::json facts = nlohmann::json::parse(row.facts_json, nullptr, false);
  if (!facts.is_object() || !facts.contains("log") || !facts["log"].is_object()) return "";
  return facts["log"].value("sha256", "");
}

absl::StatusOr<std::string> LogPath(const std::string& data_dir, const std::string& log) {
  std::string path = absl::StrCat(data_dir, "/logs/", LogFileName(log));
  struct stat info;
  if (!log.empty() && stat(path.c_str(), &info) == 0) return path;
  return absl::NotFoundError("the log of the episode, or of one before it that it can't be played "
                             "without, was never kept or was removed");
}

// The config that an evaluation was played under.
absl::StatusOr<TrackConfig> ConfigOfEvaluation(Reader& reader, int64_t id) {
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, reader.Evaluation(id));
  const absl::StatusOr<SubmissionRow> submission = reader.Submission(evaluation.submission);
  if (!submission.ok()) return submission.status();
  return StoredConfig(reader, ConfigOf(evaluation, *submission));
}

absl::StatusOr<PicturedEpisode> EpisodeIn(Reader& reader, const std::string& data_dir,
                                       const std::string& log) {
  ASSIGN_OR_RETURN(const LoggedEpisode found, reader.EpisodeOfLog(log));
  ASSIGN_OR_RETURN(TrackConfig config, ConfigOfEvaluation(reader, found.evaluation));
  PicturedEpisode shown = {std::move(config), {}, {}};
  if (CarriesOver(shown.track)) {
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.Episodes(found.evaluation));
    for (const EpisodeRow& row : rows) {
      if (row.lease != found.lease || row.index >= found.index) continue;
      ASSIGN_OR_RETURN(const std::string path, LogPath(data_dir, LogOf(row)));
      shown.episodes.push_back({row.index, row.seed, 0});
      shown.logs.push_back(path);
    }
  }
  ASSIGN_OR_RETURN(const std::string path, LogPath(data_dir, log));
  shown.episodes.push_back({found.index, found.seed, 0});
  shown.logs.push_back(path);
  return shown;
}

// Best, median and worst.
absl::StatusOr<std::vector<PictureKey>> PicturesOf(Reader& reader, int64_t evaluation) {
  ASSIGN_OR_RETURN(const TrackConfig config, ConfigOfEvaluation(reader, evaluation));
  ASSIGN_OR_RETURN(const TrackPtr track, MakeTrack(config));
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.Episodes(evaluation));
  const scoring::TrackScoring& scoring = track->scoring;
  ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*scoring.track, rows));
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, EpisodesInOrder(scoring, judged));
  std::map<int64_t, std::string> logs;
  for (const EpisodeRow& row : rows) logs[row.index] = LogOf(row);
  std::vector<PictureKey> keys;
  for (const PickedEpisode& picked : BestMedianWorst(order)) {
    if (!logs[picked.index].empty()) keys.push_back({PictureKind::kPicture, logs[picked.index]});
  }
  return keys;
}

}  // namespace

std::string PictureBuild(const std::string& cache_dir) {
  nlohmann::json build = GraderBuild(cache_dir);
  const absl::StatusOr<std::string> bin_dir = BinDir();
  const absl::StatusOr<std::string> renderer =
      bin_dir.ok() ? Sha256File(*bin_dir + "/myograde-render") : bin_dir;
  build["renderer"] = renderer.ok() ? *renderer : "";
  return Sha256Hex(CanonicalJson(build)).substr(0, kBuildDigits);
}

absl::StatusOr<PicturedEpisode> EpisodeToShow(ReaderPool& readers, const std::string& data_dir,
                                           const std::string& log) {
  ASSIGN_OR_RETURN(PicturedEpisode shown, readers.Read<PicturedEpisode>([&](Reader& reader) {
    return EpisodeIn(reader, data_dir, log);
  }));
  return shown;
}

absl::StatusOr<std::string> MakeFile(ReaderPool& readers, const std::string& data_dir,
                                     const MakerOptions& makers, const PictureKey& key,
                                     const Stopped& stopped) {
  if (key.kind == PictureKind::kModel) return MakeModel(key.of, makers, stopped);
  ASSIGN_OR_RETURN(const PicturedEpisode episode, EpisodeToShow(readers, data_dir, key.of));
  return key.kind == PictureKind::kPicture ? MakePicture(episode, makers, stopped)
                                           : MakeTrajectory(episode, makers, stopped);
}

EndedEvaluations::EndedEvaluations(ReaderPool& readers) : readers_(readers) {
  const absl::Status status = readers_.Read([&](Reader& reader) {
    seen_ = reader.LastEnd();
    return absl::OkStatus();
  });
  if (!status.ok()) spdlog::warn("pictures: {}", std::string(status.message()));
}

std::vector<PictureKey> EndedEvaluations::Pictures() {
  std::vector<PictureKey> keys;
  const absl::Status status = readers_.Read([&](Reader& reader) {
    const std::vector<EndedEvaluation> ended = reader.DoneSince(seen_, kMostEnded);
    seen_ = std::max(seen_, reader.LastEnd());
    for (const EndedEvaluation& one : ended) {
      absl::StatusOr<std::vector<PictureKey>> own = PicturesOf(reader, one.evaluation);
      if (own.ok()) {
        keys.insert(keys.end(), own->begin(), own->end());
      } else {
        spdlog::warn("pictures of evaluation {}: {}", one.evaluation,
                     std::string(own.status().message()));
      }
    }
    return absl::OkStatus();
  });
  if (!status.ok()) spdlog::warn("pictures: {}", std::string(status.message()));
  return keys;
}

}  // namespace myograde::server
