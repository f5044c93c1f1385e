// A policy graded on this host without a daemon: myograde local; try, which also writes a folder
// with a report and films to look at
#include "server/cli/offline/local.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <utility>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/outcome.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/tracks/registry.h"
#include "scoring/aggregate_json.h"
#include "scoring/episode_order.h"
#include "server/base/child_process.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/offline/draw.h"
#include "server/cli/terminal/terminal.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"
#include "server/runner/log_keeper.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// What came of a local run.
struct LocalGrade {
  Json json;                     // as `local --json` prints it
  std::vector<EpisodeRow> rows;  // by index
  TrackPtr track;
  bool interrupted = false;
};

// Everything that can be wrong with what the user gave is found here, before
// anything runs. `temp` keeps the unpacked submission.
absl::StatusOr<LocalOrder> Prepare(const LocalOptions& options, const std::string& temp) {
  ASSIGN_OR_RETURN(LocalOrder order, MakeLocalOrder(options));
  RETURN_IF_ERROR(TakeSubmission(options.path, /*name=*/"", temp, order));
  RETURN_IF_ERROR(TakeRuntimes(order));
  RETURN_IF_ERROR(CheckLocalProgram(options.path, order));
  if (!options.logs.empty()) {
    std::error_code error;
    order.log_dir = std::filesystem::absolute(options.logs).lexically_normal();
    std::filesystem::create_directories(order.log_dir, error);
    if (error) {
      return absl::InvalidArgumentError(
          absl::StrCat("--logs: ", options.logs, " can't be created: ", error.message()));
    }
  }
  return order;
}

// Names the logs in `folder` after their episodes, and says so in `rows`. The runner names them by
// their hashes.
absl::Status NameLogs(const std::string& folder, Json& rows) {
  if (folder.empty() || rows.empty()) return absl::OkStatus();
  const auto width = static_cast<int>(std::to_string(rows.back()["index"].get<int64_t>()).size());
  for (Json& row : rows) {
    if (!row["log"].is_object() || row["log"].value("sha256", "").empty()) continue;
    const std::string name =
        absl::StrFormat("episode-%0*d.lcmlog.zst", std::max(3, width), row["index"].get<int64_t>());
    std::error_code error;
    fs::rename(fs::path(folder) / LogFileName(row["log"].value("sha256", "")),
               fs::path(folder) / name, error);
    if (error) {
      return absl::InternalError(
          absl::StrCat(folder, "/", name, ": can't be created: ", error.message()));
    }
    row["log"]["file"] = name;
  }
  return absl::OkStatus();
}

absl::StatusOr<Json> ResultJson(const LocalOrder& order, const LocalResult& result,
                                absl::Duration wall) {
  const scoring::TrackScoring& scoring = order.track->scoring;
  ASSIGN_OR_RETURN(const scoring::Aggregate aggregate, AggregateRows(*scoring.track, result.rows));
  const TrackConfig& config = order.track->config;
  std::map<std::string, int64_t> outcomes;
  std::map<std::string, int64_t> reasons;
  Json rows = Json::array();
  for (const EpisodeRow& row : result.rows) {
    ++outcomes[std::string(OutcomeName(row.outcome))];
    if (row.reason != FailureReason::kNone) ++reasons[std::string(row.reason.name())];
    rows.push_back(LocalRowJson(row));
  }
  const char* state = result.interrupted ? "cancelled" : aggregate.failed ? "failed" : "done";
  return Json{{"track", config.id},
              {"track_kind", config.kind->name},
              {"profile", config.profile},
              {"state", state},
              {"name", order.artefact.manifest.name},
              {"planned", order.seeds.size()},
              {"aggregate", AggregateToJson(*scoring.track, aggregate)},
              {"official_figures", scoring.official_figures},
              {"metrics", ShownMetrics(scoring)},
              {"outcomes", outcomes},
              {"reasons", reasons},
              {"hashes",
               {{"artefact", order.artefact.digest},
                {"config", config.hash},
                {"seeds", Sha256Hex(CanonicalJson(order.seeds))},
                {"results", ResultsHash(result.rows, config.seed_salt)}}},
              {"merkle_root", result.rows.empty()
                                  ? Json()
                                  : Json(ComputeMerkleRoot(result.rows, config.seed_salt))},
              {"grader", WithRuntimes(GraderBuild(order.cache_dir, {order.artefact.manifest.adapter}),
                                       RuntimeDigests(Runtimes(order.config.runtimes,
                                                               order.config.runtimes_dir),
                                                      order.artefact.manifest.runtimes))},
              {"episode_rows", rows},
              {"output", result.outputs},
              {"wall", {{"slots", order.slots}, {"wall_s", absl::ToDoubleSeconds(wall)}}}};
}

absl::StatusOr<LocalGrade> GradeLocally(const LocalOptions& options) {
  CatchStopSignals();
  const absl::Duration start = SystemClock().Monotonic();
  ASSIGN_OR_RETURN(TempFolder temp, TempFolder::Make("local"));
  ASSIGN_OR_RETURN(LocalOrder order, Prepare(options, temp.path()));
  ASSIGN_OR_RETURN(LocalResult result, PlayLocally(order, options.track, /*report_retries=*/true));
  ASSIGN_OR_RETURN(Json json, ResultJson(order, result, SystemClock().Monotonic() - start));
  RETURN_IF_ERROR(NameLogs(order.log_dir, json["episode_rows"]));
  json["episodes"] = json["episode_rows"];  // as it was called at first
  return LocalGrade{std::move(json), std::move(result.rows), order.track, result.interrupted};
}

void PrintLocalGrade(const Json& json, bool full_hashes) {
  std::cout << Bold(Filled(json, "{name} on {track}, profile {profile}: {state}")) << '\n';
  PrintResult(json, full_hashes);
  PrintEpisodes(json["episode_rows"], json["metrics"], full_hashes);
  std::cout << "took " << DurationText(json["wall"]["wall_s"].get<double>()) << std::endl;
}

int ExitOfLocalGrade(const LocalGrade& grade) {
  if (grade.interrupted) PrintToErrors("myograde: interrupted");
  return grade.json["state"] == "done" ? kDone : kNoScore;
}

void AddLocalOptions(CLI::App& verb, LocalOptions& options, const std::string& path_name,
                     const std::string& schema) {
  AddPolicyPath(verb, path_name, options.path);
  verb.add_option("--profile", options.profile, "Rules profile (default: the track's own)");
  AddFullHashes(verb, options.full_hashes);
  AddJson(verb, schema, options.json);
  AddHostOptions(verb, options.host);
}

constexpr mode_t kReportMode = 0644;
constexpr char kFilmSize[] = "640x360";  // drawn in a quarter of the time of "render" as a rule

struct TryOptions : LocalOptions {
  std::string folder;  // "": after the policy
};

// The folder, made new and empty.
absl::StatusOr<std::string> MakeFolder(const TryOptions& options) {
  fs::path folder = options.folder;
  if (folder.empty()) {
    const fs::path policy = fs::absolute(options.path).lexically_normal();
    const fs::path name = policy.has_filename() ? policy.stem() : policy.parent_path().filename();
    folder = absl::StrCat("try-", name.string());
  }
  RETURN_IF_ERROR(MakeEmptyFolder(folder.string(), "; name another with -o"));
  return folder.string();
}

// The best and the worst of the episodes that can be shown, in the board's order.
absl::StatusOr<std::vector<scoring::PickedEpisode>> BestAndWorst(const LocalGrade& grade) {
  const scoring::TrackScoring& scoring = grade.track->scoring;
  std::vector<EpisodeRow> shown;
  for (const EpisodeRow& row : grade.rows) {
    const Json log = Json::parse(row.facts_json).value("log", Json());
    if (log.is_object() && log.value("steps", int64_t{0}) > 0) shown.push_back(row);
  }
  ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*scoring.track, shown));
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, EpisodesInOrder(scoring, judged));
  std::vector<scoring::PickedEpisode> picked = scoring::BestMedianWorst(order);
  std::erase_if(picked, [](const scoring::PickedEpisode& one) { return one.place == "median"; });
  return picked;
}

// Adds "films" to what was made, and to its "missing" why there are none or pictures.
absl::Status AddFilms(const TryOptions& options, const LocalGrade& grade, const std::string& folder,
                      Json& made) {
  ASSIGN_OR_RETURN(const std::vector<scoring::PickedEpisode> picked, BestAndWorst(grade));
  if (picked.empty()) made["missing"].push_back("No episode has any step to show.");
  const bool film = FindProgram("ffmpeg").ok();
  if (!film && !picked.empty()) {
    made["missing"].push_back(
        "There are pictures instead of films, because ffmpeg is not installed (Debian: apt-get "
        "install ffmpeg).");
  }
  for (const scoring::PickedEpisode& one : picked) {
    if (StopRequested()) return absl::CancelledError("interrupted");
    const std::string file = absl::StrCat(std::string(one.place), film ? ".mp4" : ".png");
    const Json row = RowWith(grade.json["episode_rows"], "index", one.index);
    std::vector<std::string> words = {folder + Filled(row, "/logs/{log.file}"), "-o",
                                      absl::StrCat(folder, "/", file), "--cache",
                                      options.host.cache_dir()};
    words.push_back(film ? absl::StrCat("--size=", kFilmSize) : "--strip");
    const absl::Status drawn = RunRender(std::move(words));
    if (absl::IsCancelled(drawn)) return drawn;
    if (drawn.ok()) {
      made["films"].push_back(
          {{"place", std::string(one.place)}, {"episode", one.index}, {"file", file}});
    } else {
      made["missing"].push_back(
          absl::StrCat("Episode ", one.index, " is not shown: ", drawn.message()));
    }
  }
  return absl::OkStatus();
}

// The report's order wants an evaluation as the API tells of one.
Json EvaluationOf(const LocalGrade& grade) {
  Json result = grade.json;
  result.erase("episodes");
  for (Json& row : result["episode_rows"]) {
    if (row["fault"].is_object()) row["fault"].erase("stderr_tail");
  }
  result["submission"] = nullptr;
  result["team"] = "";
  result["ranked"] = false;
  return result;
}

// Adds "report", or to "missing" why there is none.
absl::Status AddReportFile(const LocalGrade& grade, const std::string& folder, Json& made) {
  const Json order = {{"make", "report"},
                      {"format", "html"},
                      {"version", MYOGRADE_VERSION},
                      {"result", EvaluationOf(grade)}};
  const absl::StatusOr<Drawn> drawn = DrawFigure(order);
  if (absl::IsCancelled(drawn.status())) return drawn.status();
  if (!drawn.ok()) {
    made["missing"].push_back(absl::StrCat("There is no report: ", drawn.status().message()));
    return absl::OkStatus();
  }
  made["report"] = "report.html";
  return WriteNewFile(folder + "/report.html", drawn->file, kReportMode).status();
}

void PrintTried(const Json& made) {
  std::cout << '\n'
            << Bold(Filled(made, "In {folder}")) << Filled(made, "\n[  {report}  the report\n]");
  for (const Json& film : made["films"]) {
    std::cout << Filled(film, film["place"] == "only"
                                  ? "  {file}  episode {episode}\n"
                                  : "  {file}  the {place}, episode {episode}\n");
  }
  std::cout << "  logs  of all episodes, for \"myograde episode replay\" and \"myograde episode render\"\n";
  for (const Json& why : made["missing"]) std::cout << Sanitized(why.get<std::string>()) << '\n';
  std::cout << Filled(made, "[Open {open}\n]") << std::flush;
}

absl::StatusOr<int> Try(TryOptions options) {
  ASSIGN_OR_RETURN(const std::string folder, MakeFolder(options));
  options.logs = folder + "/logs";
  const absl::StatusOr<LocalGrade> grade = GradeLocally(options);
  if (!grade.ok()) {
    std::error_code ignored;
    fs::remove_all(options.logs, ignored);
    fs::remove(folder, ignored);
    return grade.status();
  }
  if (!options.json) PrintLocalGrade(grade->json, options.full_hashes);
  Json made = {{"folder", folder},
               {"report", nullptr},
               {"films", Json::array()},
               {"missing", Json::array()},
               {"open", nullptr},
               {"result", grade->json}};
  absl::Status added = grade->interrupted ? absl::CancelledError("interrupted")
                                          : AddFilms(options, *grade, folder, made);
  if (added.ok()) added = AddReportFile(*grade, folder, made);
  if (!added.ok() && !absl::IsCancelled(added)) return added;
  if (!added.ok()) made["missing"].push_back("It was interrupted.");
  // What to open first.
  if (made["report"].is_string()) {
    made["open"] = folder + "/report.html";
  } else if (!made["films"].empty()) {
    made["open"] = absl::StrCat(folder, "/", TextAt(made["films"][0], "file"));
  }
  const int exit = ExitOfLocalGrade(*grade);
  return PrintAnswer(made, options.json, PrintTried, added.ok() ? exit : kNoScore);
}

}  // namespace

Command AddLocal(CLI::App& verb) {
  auto options = std::make_shared<LocalOptions>();
  AddLocalOptions(verb, *options, "PATH", "local");
  verb.add_option("--track", options->track, "Name of the track, as \"myograde spec\" lists them")
      ->required();
  verb.add_option("--seeds", options->seeds,
                  "File of seeds to play instead of the track's list: a JSON array, or one seed a "
                  "line");
  verb.add_option("--episodes", options->episodes, "Play only the first N seeds")
      ->check(CLI::Range(1, 10'000));
  verb.add_option("--logs", options->logs,
                  "Folder for the log of each episode, episode-000.lcmlog.zst and so on, for "
                  "\"myograde episode replay\" and \"myograde episode render\"");
  verb.add_option("--slots", options->slots,
                  "Blocks of episodes to play in parallel (default: as in server.json, one for "
                  "each processor)")
      ->check(CLI::Range(1, 1024));
  return [options]() -> absl::StatusOr<int> {
    ASSIGN_OR_RETURN(const LocalGrade grade, GradeLocally(*options));
    const auto print = [&](const Json& json) { PrintLocalGrade(json, options->full_hashes); };
    return PrintAnswer(grade.json, options->json, print, ExitOfLocalGrade(grade));
  };
}

Command AddTry(CLI::App& verb) {
  auto options = std::make_shared<TryOptions>();
  options->track = TrackNames().back();  // the quickest, and the one that newcomers begin with
  options->episodes = 5;
  AddLocalOptions(verb, *options, "POLICY", "try");
  verb.add_option(
      "--track", options->track,
      "Name of the track, as \"myograde spec\" lists them (default: " + options->track + ")");
  verb.add_option("--episodes", options->episodes, "Play the first N seeds of the track (default: 5)")
      ->check(CLI::Range(1, 10'000));
  verb.add_option("-o,--output", options->folder,
                  "The folder to write, new or empty (default: try-NAME, after the policy's file "
                  "name)");
  return [options] { return Try(*options); };
}

}  // namespace myograde::server
