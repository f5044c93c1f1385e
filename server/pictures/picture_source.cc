#include "server/pictures/picture_source.h"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/render_order.h"
#include "protocol/lease/sim_channel.h"
#include "scoring/episode_order.h"
#include "server/base/child_process.h"
#include "server/base/json_value.h"
#include "server/base/paths.h"
#include "server/grading/results.h"
#include "server/grading/tracks.h"
#include "server/proof/grader_build.h"
#include "server/proof/replay_run.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMostEnded = 20;
constexpr size_t kBuildDigits = 16;
constexpr int kWidth = 320, kHeight = 180;  // pixels
constexpr size_t kMostPictureBytes = 1 << 20;
constexpr absl::Duration kPictureTime = absl::Minutes(10);
constexpr absl::Duration kTimePerLog = absl::Minutes(1);  // that a picture plays first
// Of the longest lease whose state carries over, on processors that all grade.
constexpr absl::Duration kTrajectoryTime = absl::Minutes(30);

// An episode to show, as the store knows it.
struct PicturedEpisode {
  TrackConfig track;  // that it was played under
  std::vector<EpisodeOrder>
      episodes;                   // it is the last; before it those that it can't be played without
  std::vector<std::string> logs;  // a file for each
};

void RemoveFolder(const std::string& path) {
  std::error_code ignored;
  fs::remove_all(path, ignored);
}

absl::Status MakeEmptyFolder(const std::string& path) {
  std::error_code error;
  fs::remove_all(path, error);
  if (!error) fs::create_directories(path, error);
  if (!error) fs::permissions(path, fs::perms::owner_all, error);
  if (!error) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(path, ": can't be created: ", error.message()));
}

// A file that one of the grader's programs has written.
absl::StatusOr<std::string> ReadMade(const std::string& path, size_t most = kAnySize) {
  absl::StatusOr<std::string> bytes = ReadFile(path, most);
  if (!bytes.ok()) return absl::InternalError(bytes.status().message());
  return bytes;
}

// The first sentence of what a program printed as its reason.
std::string ExplainEnd(const ProgramEnd& end, const std::string& program) {
  absl::string_view text = end.errors;
  while (absl::ConsumeSuffix(&text, "\n")) continue;
  absl::ConsumePrefix(&text, program + ": ");
  if (!text.empty()) return std::string(text);
  return absl::StrCat(program, " ended with status ", end.exit_status, " and no reason");
}

absl::StatusOr<std::string> MakeTrajectory(const PicturedEpisode& episode,
                                           const MakerOptions& options, const Stopped& stopped) {
  RETURN_IF_ERROR(MakeEmptyFolder(options.work_dir));
  const absl::Cleanup remove = [&] { RemoveFolder(options.work_dir); };
  const std::string file = options.work_dir + "/trajectory";
  ReplayOrder order;
  order.track = episode.track;
  order.blocks = {{episode.episodes, episode.logs, file}};
  order.work_dir = options.work_dir;
  order.cache_dir = options.cache_dir;
  order.uid_base = options.uid;
  order.background = true;
  const Deadline deadline(kTrajectoryTime);
  const absl::StatusOr<std::vector<ReplayRecord>> records =
      RunReplay(order, {.stopped = [&] { return stopped() || deadline.over(); }});
  if (absl::IsCancelled(records.status()) && !stopped()) {
    return absl::DeadlineExceededError(
        absl::StrCat("the episode was not played after ", absl::FormatDuration(kTrajectoryTime)));
  }
  RETURN_IF_ERROR(records.status());
  if (records->empty() || !records->back().equal) {
    return absl::DataLossError(
        absl::StrCat("this build of the grader does not play the episode as it was recorded: ",
                     records->empty() ? "nothing was played" : records->back().detail));
  }
  return ReadMade(file, kMostTrajectoryFileBytes);
}

absl::StatusOr<std::string> MakePicture(const PicturedEpisode& episode, const MakerOptions& options,
                                        const Stopped& stopped) {
  const absl::Duration time =
      kPictureTime + static_cast<double>(episode.logs.size() - 1) * kTimePerLog;
  RenderOrder order;
  order.track = episode.track;
  order.cache_dir = options.cache_dir;
  order.episodes = {{.logs = episode.logs, .title = "", .verdict = ""}};
  order.form = RenderOrder::Form::kPicture;
  order.width = kWidth;
  order.height = kHeight;
  order.overlay = false;
  order.deadline_s = absl::ToDoubleSeconds(time);
  ASSIGN_OR_RETURN(const ProgramEnd end, RunProgram({.program = "myograde-render",
                                                     .input = RenderOrderToJson(order).dump(),
                                                     .most_output = kMostPictureBytes,
                                                     .deadline = time},
                                                    stopped));
  if (end.exit_status == kRendered) return end.output;
  const std::string why = ExplainEnd(end, "myograde-render");
  return end.exit_status == kRenderLogFault ? absl::DataLossError(why) : absl::InternalError(why);
}

absl::StatusOr<std::string> MakeModel(const std::string& track, const MakerOptions& options,
                                      const Stopped& stopped) {
  RETURN_IF_ERROR(MakeEmptyFolder(options.work_dir));
  const absl::Cleanup remove = [&] { RemoveFolder(options.work_dir); };
  const std::string file = options.work_dir + "/model.glb";
  ASSIGN_OR_RETURN(const ProgramEnd end,
                   RunProgram({.program = "myograde-sim",
                               .words = {"--model-file", track, file, options.cache_dir},
                               .deadline = kPictureTime},
                              stopped));
  if (end.exit_status != 0) return absl::InternalError(ExplainEnd(end, "myograde-sim"));
  return ReadMade(file);
}

// Of the log of an episode; "" if it has none, or can't be read.
std::string LogSha256(const EpisodeRow& row) {
  const nlohmann::json facts = ParsedText(row.facts_json);
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

// What an evaluation was played under.
absl::StatusOr<TrackPtr> TrackOfEvaluation(const Transaction& reader, int64_t id) {
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, reader.evaluations.Find(id));
  return StoredTrack(reader, evaluation.config);
}

// The episode of a log, with what it can't be played without.
absl::StatusOr<PicturedEpisode> EpisodeOf(const Transaction& reader, const std::string& data_dir,
                                          const std::string& log) {
  ASSIGN_OR_RETURN(const EpisodeRow found, reader.episodes.OfLog(log));
  ASSIGN_OR_RETURN(const TrackPtr track, TrackOfEvaluation(reader, found.evaluation));
  PicturedEpisode shown = {track->config, {}, {}};
  if (CarriesOver(shown.track)) {
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.episodes.Of(found.evaluation));
    for (const EpisodeRow& row : rows) {
      if (row.block != found.block || row.index >= found.index) continue;
      ASSIGN_OR_RETURN(const std::string path, LogPath(data_dir, LogSha256(row)));
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
absl::StatusOr<std::vector<PictureKey>> PicturesOf(const Transaction& reader, int64_t evaluation) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackOfEvaluation(reader, evaluation));
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.episodes.Of(evaluation));
  const scoring::TrackScoring& scoring = track->scoring;
  ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*scoring.track, rows));
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, EpisodesInOrder(scoring, judged));
  std::map<int64_t, std::string> logs;
  for (const EpisodeRow& row : rows) logs[row.index] = LogSha256(row);
  std::vector<PictureKey> keys;
  for (const scoring::PickedEpisode& picked : scoring::BestMedianWorst(order)) {
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

absl::StatusOr<std::string> MakeFile(ReaderPool& readers, const std::string& data_dir,
                                     const MakerOptions& makers, const PictureKey& key,
                                     const Stopped& stopped) {
  if (key.kind == PictureKind::kModel) return MakeModel(key.of, makers, stopped);
  ASSIGN_OR_RETURN(const PicturedEpisode episode,
                   readers.Read<PicturedEpisode>([&](const Transaction& reader) {
                     return EpisodeOf(reader, data_dir, key.of);
                   }));
  return key.kind == PictureKind::kPicture ? MakePicture(episode, makers, stopped)
                                           : MakeTrajectory(episode, makers, stopped);
}

std::function<std::vector<PictureKey>()> PicturesOfEnded(ReaderPool& readers) {
  const absl::StatusOr<int64_t> last = readers.Read<int64_t>(
      [](const Transaction& reader) { return reader.evaluations.LastEnd(); });
  if (!last.ok()) spdlog::warn("pictures: {}", std::string(last.status().message()));
  // `seen`: when the last one that was seen ended, in ms since 1970.
  return [&readers, seen = last.value_or(0)]() mutable {
    std::vector<PictureKey> keys;
    const absl::Status status = readers.Read([&](const Transaction& reader) {
      const std::vector<int64_t> ended = reader.evaluations.DoneSince(seen, kMostEnded);
      seen = std::max(seen, reader.evaluations.LastEnd());
      for (const int64_t evaluation : ended) {
        const auto own = PicturesOf(reader, evaluation);
        if (own.ok()) {
          keys.insert(keys.end(), own->begin(), own->end());
        } else {
          spdlog::warn("pictures of evaluation {}: {}", evaluation,
                       std::string(own.status().message()));
        }
      }
      return absl::OkStatus();
    });
    if (!status.ok()) spdlog::warn("pictures: {}", std::string(status.message()));
    return keys;
  };
}

}  // namespace myograde::server
