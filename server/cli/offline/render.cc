// myograde episode render
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/outcome.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/render_order.h"
#include "protocol/log/episode_log.h"
#include "protocol/tracks/registry.h"
#include "scoring/episode_order.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/offline/draw.h"
#include "server/cli/offline/play_logs.h"
#include "server/cli/terminal/terminal.h"
#include "server/grading/results.h"
#include "server/grading/tracks.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

using Form = RenderOrder::Form;

constexpr int kMostDrawingThreads = 16;
constexpr double kDeadlineSeconds = 600;   // of loading, and of a picture
constexpr double kSecondsPerLog = 60;      // of playing one that comes before, on processors that all grade
constexpr double kSecondsPerFrame = 10;

struct RenderOptions : DaemonOptions {
  HostOptions host;  // of which the cache alone
  std::string target;
  int64_t episode = -1;  // -1: not said
  std::string file;
  std::string size;      // "": by form
  double at = -1;        // s; below 0: not said
  double speed = 1;
  bool strip = false;
  bool no_overlay = false;
};

// What is drawn, and where from.
struct Drawing {
  RenderOrder order;
  std::optional<FilmFormat> film;  // else a PNG
  int64_t frames = 1;
  // Of the verb's answer, with what is known of each of the order's episodes.
  Json answer = {{"submission", nullptr}, {"evaluation", nullptr}, {"episodes", Json::array()}};
};

bool ReadSize(const std::string& text, int& width, int& height) {
  const std::vector<std::string> sides = absl::StrSplit(text, absl::MaxSplits('x', 1));
  const auto good = [](int side) {
    return side >= kSmallestRenderSide && side <= kLargestRenderSide;
  };
  return sides.size() == 2 && absl::SimpleAtoi(sides[0], &width) &&
         absl::SimpleAtoi(sides[1], &height) && good(width) && good(height);
}

std::string SizeMistake(const std::string& text) {
  int width = 0;
  int height = 0;
  if (ReadSize(text, width, height)) return "";
  return absl::StrCat("\"", Sanitized(text.substr(0, 40)),
                      "\" is not a size: write WIDTHxHEIGHT, each ", kSmallestRenderSide, " to ",
                      kLargestRenderSide, " pixels");
}

absl::Status ReadOptions(const RenderOptions& options, Drawing& drawing) {
  RenderOrder& order = drawing.order;
  const bool png = absl::EndsWithIgnoreCase(options.file, ".png");
  if (absl::EndsWithIgnoreCase(options.file, ".mp4")) drawing.film = FilmFormat::kMp4;
  if (absl::EndsWithIgnoreCase(options.file, ".webm")) drawing.film = FilmFormat::kWebm;
  const bool film = drawing.film.has_value();
  order.form = film ? Form::kFilm : options.strip ? Form::kStrip : Form::kPicture;
  order.width = options.strip ? 384 : 1280;
  order.height = options.strip ? 216 : 720;
  ReadSize(options.size, order.width, order.height);  // CLI11 has checked it
  order.cache_dir = options.host.cache_dir();
  order.overlay = !options.no_overlay;
  order.speed = options.speed;
  if (options.at >= 0) order.at_s = options.at;
  order.threads = std::clamp(static_cast<int>(std::thread::hardware_concurrency()), 1,
                             kMostDrawingThreads);
  return RefuseIf(
      {{!png && !film, absl::StrCat("--output: ", Sanitized(options.file),
                                    ": the name must end in .mp4, .webm or .png")},
       {options.strip && !png, "--strip: a strip is a picture; write a .png"},
       {options.strip && options.episode >= 0,
        "--strip: picks the episodes itself; leave --episode out"},
       {options.at >= 0 && (film || options.strip),
        "--at: only for a picture of one moment; write a .png without --strip"},
       {options.speed != 1 && !film, "--speed: only for films; write a .mp4 or .webm"},
       {film && (order.width % 2 != 0 || order.height % 2 != 0),
        "--size: the sides of a film must be even"}});
}

absl::Status CheckHasSteps(const EpisodeLog& log) {
  if (log.steps() > 0) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("episode ", log.header.episode,
                                          " has no step to show: it ended by \"", log.end.end,
                                          "\" before the first"));
}

// `place`: "best", "median", "worst" or "only" in a strip; else "". `log`: that of the episode itself.
void AddShown(const std::string& place, const EpisodeLog& log, RenderEpisode episode,
              Drawing& drawing) {
  drawing.answer["episodes"].push_back({{"index", log.header.episode},
                                        {"place", TextOrNull(place)},
                                        {"steps", log.steps()},
                                        {"verdict", TextOrNull(episode.verdict)}});
  drawing.order.track = log.header.track;
  drawing.order.episodes.push_back(std::move(episode));
}

// What scoring reads of a row, from what the API shows of it; nullopt if the phase withholds that.
std::optional<EpisodeRow> StoredForm(const Json& row, std::string_view track) {
  const std::optional<Outcome> outcome = ParseOutcome(TextAt(row, "outcome"));
  const std::optional<FailureReason> reason = ParseFailureReason(TextAt(row, "reason"));
  if (!outcome.has_value() || !reason.has_value() || !row.value("metrics", Json()).is_object()) {
    return std::nullopt;
  }
  EpisodeRow stored;
  stored.index = row.value("index", int64_t{0});
  stored.outcome = *outcome;
  stored.reason = *reason;
  stored.metrics_json = row["metrics"].dump();
  const Json facts = {{"steps", row.value("steps", Json())},
                      {std::string(track), row.value("facts", Json())}};
  stored.facts_json = facts.dump();
  return stored;
}

absl::StatusOr<std::vector<int64_t>> ChooseEpisodes(const std::vector<Json>& rows,
                                                    const TrackConfig& config) {
  ASSIGN_OR_RETURN(const TrackPtr track, MakeTrack(config));
  std::vector<EpisodeRow> stored;
  for (const Json& row : rows) {
    std::optional<EpisodeRow> form = StoredForm(row, config.kind->name);
    if (!form.has_value()) {
      return absl::FailedPreconditionError(absl::StrCat(
          "the phase withholds the episodes' results, so the best is not known; choose one with "
          "--episode"));
    }
    stored.push_back(*std::move(form));
  }
  ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*track->scoring.track, stored));
  return EpisodesInOrder(track->scoring, judged);
}

// The episode of a log file. DataLossError if it is damaged or has no step, NotFoundError if it can't
// be opened. Other errors as of LogsUpTo.
absl::Status AddOfFile(const RenderOptions& options, Drawing& drawing) {
  RETURN_IF_ERROR(RefuseIf({{options.episode >= 0,
                             "--episode: a log file holds one episode; leave the option out"}}));
  ASSIGN_OR_RETURN(const EpisodeLog log, ParseLog(ReadLog(options.target)));
  RETURN_IF_ERROR(CheckHasSteps(log));
  RenderEpisode shown;
  ASSIGN_OR_RETURN(const auto files, LogsUpTo(options.target, log.header));
  for (const auto& [episode, file] : files) shown.logs.push_back(file.path);
  if (options.strip) shown.title = absl::StrCat("episode ", log.header.episode);
  AddShown(options.strip ? "only" : "", log, std::move(shown), drawing);
  return absl::OkStatus();
}

// One episode of an evaluation with rows, its logs in `folder`. OutOfRangeError,
// FailedPreconditionError: there is no such episode, or no log of it. Other errors as of FetchLogBytes.
absl::Status AddEpisode(const Client& client, const Json& evaluation, int64_t index,
                        const std::string& place, const std::string& title,
                        const std::string& folder, Drawing& drawing) {
  ASSIGN_OR_RETURN(const FetchedLog own, FetchLog(client, evaluation, index, folder));
  RETURN_IF_ERROR(CheckHasSteps(own.log));
  RenderEpisode shown;
  for (int64_t before = FirstNeeded(own.log.header.track, index); before < index; ++before) {
    ASSIGN_OR_RETURN(const FetchedLog log, FetchLog(client, evaluation, before, folder));
    shown.logs.push_back(log.file.path);
  }
  shown.logs.push_back(own.file.path);
  shown.title = title;
  // "failure: dropped"; "" where the phase withholds it.
  shown.verdict = Filled(*RowOf(evaluation, index), "[{outcome}][: {reason}]");
  AddShown(place, own.log, std::move(shown), drawing);
  return absl::OkStatus();
}

// The best, the median and the worst of the episodes that can be shown, in the board's order.
// FailedPreconditionError if there is none. Other errors likewise.
absl::Status AddStrip(const Client& client, const Json& evaluation, const std::string& folder,
                      Drawing& drawing) {
  std::vector<Json> rows;
  for (const Json& row : evaluation["episode_rows"]) {
    const Json log = row.value("log", Json());
    const bool shown = log.is_object() && log.value("steps", int64_t{0}) > 0;
    if (shown && TextAt(row, "end") != scoring::kPhantom) rows.push_back(row);
  }
  if (rows.empty()) {
    return absl::FailedPreconditionError(
        Filled(evaluation, "submission {submission} has no episode with a log to show"));
  }
  // A log has the config, and with it the board's rules.
  ASSIGN_OR_RETURN(const FetchedLog any,
                   FetchLog(client, evaluation, rows.front().value("index", int64_t{-1}), folder));
  ASSIGN_OR_RETURN(const std::vector<int64_t> order, ChooseEpisodes(rows, any.log.header.track));
  for (const scoring::PickedEpisode& picked : scoring::BestMedianWorst(order)) {
    const std::string place(picked.place);
    RETURN_IF_ERROR(AddEpisode(client, evaluation, picked.index, place,
                               absl::StrCat(place, ": episode ", picked.index), folder, drawing));
  }
  return absl::OkStatus();
}

absl::Status AddOfSubmission(const RenderOptions& options, int64_t id, const std::string& folder,
                             Drawing& drawing) {
  RETURN_IF_ERROR(RefuseIf({{!options.strip && options.episode < 0,
                             "--episode: name the episode to show, or ask for a --strip"}}));
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json evaluation,
                   EvaluationWithRows(client, absl::StrCat("/v1/submissions/", id, "/result")));
  drawing.answer["submission"] = id;
  drawing.answer["evaluation"] = evaluation.value("evaluation", Json());
  if (options.strip) return AddStrip(client, evaluation, folder, drawing);
  return AddEpisode(client, evaluation, options.episode, "",
                    absl::StrCat("submission ", id, Filled(evaluation, " of {team}")), folder,
                    drawing);
}

absl::Status Find(const RenderOptions& options, const std::string& folder, Drawing& drawing) {
  int64_t id = 0;
  const bool numbered = absl::SimpleAtoi(options.target, &id) && id > 0;
  RETURN_IF_ERROR(
      numbered ? AddOfSubmission(options, id, folder, drawing) : AddOfFile(options, drawing));
  RenderOrder& order = drawing.order;
  order.deadline_s = kDeadlineSeconds;
  for (const RenderEpisode& episode : order.episodes) {
    order.deadline_s += kSecondsPerLog * static_cast<double>(episode.logs.size() - 1);
  }
  if (drawing.film) {
    const int64_t steps = drawing.answer["episodes"][0]["steps"];
    drawing.frames = FilmFrames(order, steps, order.track.kind->control_period_s);
    order.deadline_s += kSecondsPerFrame * static_cast<double>(drawing.frames);
  }
  return absl::OkStatus();
}

// The finished bytes of the picture or film.
absl::StatusOr<std::string> Draw(const Drawing& drawing, const std::string& folder) {
  if (!drawing.film) return DrawPng(drawing.order, folder);
  const std::string part = folder + "/film";
  Progress progress("render");
  RETURN_IF_ERROR(EncodeFilm(drawing.order, *drawing.film, folder, part, [&](int64_t frame) {
        progress.Show(std::min(frame, drawing.frames), drawing.frames, "pictures");
      }));
  return ReadFile(part);
}

Json AnswerOf(const RenderOptions& options, const Drawing& drawing, const std::string& bytes,
              const std::string& sha256) {
  const RenderOrder& order = drawing.order;
  const bool film = drawing.film.has_value();
  const double seconds = static_cast<double>(drawing.frames) / order.frames_per_second;
  Json answer = drawing.answer;
  answer.update({{"file", options.file},
                 {"sha256", sha256},
                 {"bytes", bytes.size()},
                 {"form", film ? "film" : options.strip ? "strip" : "picture"},
                 {"width", order.width},
                 {"height", order.height},
                 {"frames", drawing.frames},
                 {"frames_per_second", film ? Json(order.frames_per_second) : Json()},
                 {"seconds", film ? Json(seconds) : Json()}});
  return answer;
}

void PrintDrawn(const Json& json) {
  std::cout << Filled(json, "{file}: ");
  if (json["form"] == "film") {
    std::cout << Filled(json, "{frames:picture}, ") << Cell(json, "seconds", 1) << " s, ";
  }
  std::cout << Filled(json, "{width}x{height}, {bytes:byte}");
  const char* comma = "; ";
  for (const Json& episode : json["episodes"]) {
    std::cout << comma << Filled(episode, "[{place}: ]episode {index}[ ({verdict})]");
    comma = ", ";
  }
  std::cout << std::endl;
}

absl::StatusOr<int> Render(const RenderOptions& options) {
  Drawing drawing;
  RETURN_IF_ERROR(ReadOptions(options, drawing));
  ASSIGN_OR_RETURN(const TempFolder temp, TempFolder::Make("render"));
  if (absl::Status status = Find(options, temp.path(), drawing); !status.ok()) {
    return ExitOfLogError(status);
  }
  // Opened before the work: a place that can't be written to is told at once.
  NewFile file(options.file, /*mode=*/0666);
  RETURN_IF_ERROR(file.status());
  const absl::StatusOr<std::string> bytes = Draw(drawing, temp.path());
  if (!bytes.ok()) return ExitOfLogError(bytes.status());
  RETURN_IF_ERROR(file.Write(*bytes));
  ASSIGN_OR_RETURN(const std::string sha256, file.Keep());
  return PrintAnswer(AnswerOf(options, drawing, *bytes, sha256), options.json, PrintDrawn);
}

}  // namespace

Command AddRender(CLI::App& verb) {
  auto options = std::make_shared<RenderOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde episode log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "The episode, counted from 0")
      ->check(WholeNumber(0, "not an episode's number, counted from 0"));
  verb.add_option("-o,--output", options->file,
                  "The file to write: .mp4 or .webm for a film, .png for a picture")
      ->required();
  verb.add_flag("--strip", options->strip,
                "One picture with a row each for the best, the median and the worst episode; for "
                "a log file, one row");
  verb.add_option("--size", options->size,
                  "WIDTHxHEIGHT in pixels (default: 1280x720, and 384x216 for each picture of a "
                  "strip)")
      ->check(CLI::Validator(SizeMistake, ""));
  verb.add_option("--at", options->at,
                  "For a .png: the moment, in seconds of simulated time (default: the end)")
      ->check(CLI::Range(0.0, 1e6));
  verb.add_option("--speed", options->speed, "For a film: 0.5 is half as fast (default: 1)")
      ->check(CLI::Range(0.01, 100.0));
  verb.add_flag("--no-overlay", options->no_overlay, "No text in the pictures");
  AddDaemonOptions(verb, "render", *options);
  verb.add_option("--cache", options->host.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "~/.cache/myograde if it has models, else /var/cache/myograde)");
  return [options] { return Render(*options); };
}

}  // namespace myograde::server
