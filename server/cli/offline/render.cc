// myograde render
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_split.h>

#include <algorithm>
#include <cerrno>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/draw_episodes.h"
#include "server/cli/offline/shown_episodes.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/text.h"

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
  ShownEpisodes shown;
  std::optional<FilmFormat> film;  // else a PNG
  int64_t frames = 1;
  Json submission;  // their numbers, or null
  Json evaluation;
};

std::string SizeMistake(const std::string& text) {
  const std::pair<std::string, std::string> sides = absl::StrSplit(text, absl::MaxSplits('x', 1));
  for (const std::string& side : {sides.first, sides.second}) {
    int pixels = 0;
    if (!absl::SimpleAtoi(side, &pixels) || pixels < kSmallestRenderSide ||
        pixels > kLargestRenderSide) {
      return absl::StrCat("\"", Harmless(text.substr(0, 40)), "\" is no size: write WIDTHxHEIGHT, "
                          "each ", kSmallestRenderSide, " to ", kLargestRenderSide, " pixels");
    }
  }
  return "";
}

absl::Status WrongOption(const std::string& problem) {
  return absl::InvalidArgumentError(problem);
}

// The form and the format that the options ask for.
absl::Status ReadForm(const RenderOptions& options, Drawing& drawing) {
  const bool png = absl::EndsWithIgnoreCase(options.file, ".png");
  if (absl::EndsWithIgnoreCase(options.file, ".mp4")) drawing.film = FilmFormat::kMp4;
  if (absl::EndsWithIgnoreCase(options.file, ".webm")) drawing.film = FilmFormat::kWebm;
  if (!png && !drawing.film) {
    return WrongOption(absl::StrCat("--output: ", Harmless(options.file),
                                    ": the name must end in .mp4, .webm or .png"));
  }
  if (options.strip && !png) return WrongOption("--strip: a strip is a picture; write a .png");
  if (options.strip && options.episode >= 0) {
    return WrongOption("--strip: it picks the episodes itself; leave --episode out");
  }
  if (options.at >= 0 && (drawing.film || options.strip)) {
    return WrongOption("--at: it is for a picture of one moment; write a .png without --strip");
  }
  if (options.speed != 1 && !drawing.film) {
    return WrongOption("--speed: it is for films; write a .mp4 or .webm");
  }
  drawing.order.form = drawing.film ? Form::kFilm : options.strip ? Form::kStrip : Form::kPicture;
  return absl::OkStatus();
}

absl::Status ReadSize(const RenderOptions& options, Drawing& drawing) {
  RenderOrder& order = drawing.order;
  order.width = options.strip ? 384 : 1280;
  order.height = options.strip ? 216 : 720;
  if (!options.size.empty()) {
    const std::vector<std::string> sides = absl::StrSplit(options.size, 'x');
    if (!absl::SimpleAtoi(sides[0], &order.width) || !absl::SimpleAtoi(sides[1], &order.height)) {
      return WrongOption(SizeMistake(options.size));
    }
  }
  if (drawing.film && (order.width % 2 != 0 || order.height % 2 != 0)) {
    return WrongOption("--size: the sides of a film must be even");
  }
  return absl::OkStatus();
}

absl::Status ReadOptions(const RenderOptions& options, Drawing& drawing) {
  RETURN_IF_ERROR(ReadForm(options, drawing));
  RETURN_IF_ERROR(ReadSize(options, drawing));
  RenderOrder& order = drawing.order;
  order.cache_dir = options.host.cache_dir();
  order.overlay = !options.no_overlay;
  order.speed = options.speed;
  if (options.at >= 0) order.at_s = options.at;
  order.threads = std::clamp(static_cast<int>(std::thread::hardware_concurrency()), 1,
                             kMostDrawingThreads);
  return absl::OkStatus();
}

absl::Status FindOfSubmission(const RenderOptions& options, int64_t id, const std::string& folder,
                              Drawing& drawing) {
  if (!options.strip && options.episode < 0) {
    return WrongOption("--episode: name the episode to show, or ask for a --strip");
  }
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json evaluation,
                   EvaluationWithRows(client, absl::StrCat("/v1/submissions/", id, "/result")));
  ASSIGN_OR_RETURN(drawing.shown, options.strip ? StripOfEvaluation(client, evaluation, folder)
                                                : EpisodeOfEvaluation(client, evaluation,
                                                                      options.episode, folder));
  drawing.submission = id;
  drawing.evaluation = evaluation.value("evaluation", Json());
  if (!options.strip) {
    drawing.shown.episodes.front().order.title =
        absl::StrCat("submission ", id, " of ", Cell(evaluation, "team"));
  }
  return absl::OkStatus();
}

absl::Status FindOfFile(const RenderOptions& options, Drawing& drawing) {
  if (options.episode >= 0) {
    return WrongOption("--episode: a log file holds one episode; leave the option out");
  }
  ASSIGN_OR_RETURN(drawing.shown, EpisodeOfFile(options.target));
  if (options.strip) {
    ShownEpisode& episode = drawing.shown.episodes.front();
    episode.place = "only";
    episode.order.title = absl::StrCat("episode ", episode.index);
  }
  return absl::OkStatus();
}

absl::Status Find(const RenderOptions& options, const std::string& folder, Drawing& drawing) {
  int64_t id = 0;
  const bool numbered = absl::SimpleAtoi(options.target, &id) && id > 0;
  RETURN_IF_ERROR(
      numbered ? FindOfSubmission(options, id, folder, drawing) : FindOfFile(options, drawing));
  RenderOrder& order = drawing.order;
  order.track = drawing.shown.track;
  order.deadline_s = kDeadlineSeconds;
  for (const ShownEpisode& episode : drawing.shown.episodes) {
    order.episodes.push_back(episode.order);
    order.deadline_s += kSecondsPerLog * static_cast<double>(episode.order.logs.size() - 1);
  }
  if (drawing.film) {
    drawing.frames = FilmFrames(order, drawing.shown.episodes.front().steps,
                                order.track.kind->control_period_s);
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

Json ToJson(const RenderOptions& options, const Drawing& drawing, const std::string& bytes,
            const std::string& sha256) {
  const RenderOrder& order = drawing.order;
  Json episodes = Json::array();
  for (const ShownEpisode& shown : drawing.shown.episodes) {
    episodes.push_back({{"index", shown.index},
                        {"place", TextOrNull(shown.place)},
                        {"steps", shown.steps},
                        {"verdict", TextOrNull(shown.order.verdict)}});
  }
  const bool film = drawing.film.has_value();
  return {{"submission", drawing.submission},
          {"evaluation", drawing.evaluation},
          {"file", options.file},
          {"sha256", sha256},
          {"bytes", bytes.size()},
          {"form", film ? "film" : options.strip ? "strip" : "picture"},
          {"width", order.width},
          {"height", order.height},
          {"frames", drawing.frames},
          {"frames_per_second", film ? Json(order.frames_per_second) : Json()},
          {"seconds", film ? Json(static_cast<double>(drawing.frames) / order.frames_per_second)
                           : Json()},
          {"episodes", std::move(episodes)}};
}

void PrintDrawn(const Json& json) {
  std::cout << Harmless(json["file"].get<std::string>()) << ": ";
  if (json["form"] == "film") {
    std::cout << CountCell(json, "frames", "picture") << ", "
              << absl::StrFormat("%.1f s", json["seconds"].get<double>()) << ", ";
  }
  std::cout << json["width"] << "x" << json["height"] << ", " << CountCell(json, "bytes", "byte");
  const char* comma = "; ";
  for (const Json& episode : json["episodes"]) {
    std::cout << comma;
    if (episode["place"].is_string()) std::cout << episode["place"].get<std::string>() << ": ";
    std::cout << "episode " << episode["index"];
    if (episode["verdict"].is_string()) {
      std::cout << " (" << Harmless(episode["verdict"].get<std::string>()) << ")";
    }
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
  if (!file.opened()) return CantWrite(options.file);
  const absl::StatusOr<std::string> bytes = Draw(drawing, temp.path());
  if (!bytes.ok()) return ExitOfLogError(bytes.status());
  if (!file.Write(*bytes)) {
    errno = file.error();
    return CantWrite(options.file);
  }
  ASSIGN_OR_RETURN(const std::string sha256, file.Keep());
  return PrintAnswer(ToJson(options, drawing, *bytes, sha256), options.json, PrintDrawn);
}

}  // namespace

Action AddRender(CLI::App& verb) {
  auto options = std::make_shared<RenderOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "The episode, counted from 0")
      ->check(WholeNumber(0, "no episode's number, counted from 0"));
  verb.add_option("-o,--output", options->file,
                  "The file to write: .mp4 or .webm for a film, .png for a picture")
      ->required();
  verb.add_flag("--strip", options->strip,
                "One picture with a row for each of the best, the median and the worst episode, or of a "
                "log's file with one row");
  verb.add_option("--size", options->size,
                  "WIDTHxHEIGHT in pixels (default: 1280x720, and 384x216 for each picture of a "
                  "strip)")
      ->check(CLI::Validator(SizeMistake, ""));
  verb.add_option("--at", options->at,
                  "For a .png: the moment in s of simulated time (default: the end)")
      ->check(CLI::Range(0.0, 1e6));
  verb.add_option("--speed", options->speed, "For a film: 0.5 is half as fast (default: 1)")
      ->check(CLI::Range(0.01, 100.0));
  verb.add_flag("--no-overlay", options->no_overlay, "Nothing written into the pictures");
  AddDaemonOptions(verb, "render", *options);
  verb.add_option("--cache", options->host.cache,
                  "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                  "~/.cache/myograde if it has models, else /var/cache/myograde)");
  return [options] { return Render(*options); };
}

}  // namespace myograde::server
