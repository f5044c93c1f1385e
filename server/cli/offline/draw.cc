#include "server/cli/offline/draw.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <set>
#include <string_view>
#include <utility>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/json_value.h"
#include "server/base/paths.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";
constexpr absl::Duration kDrawingTime = absl::Minutes(10);
constexpr size_t kMostDrawn = size_t{512} << 20;
constexpr mode_t kFigureMode = 0644;
constexpr int kDrawingNice = 10;  // of all that draws
constexpr absl::Duration kRenderTime = absl::Hours(24);  // "render" has a deadline of its own
constexpr size_t kMostRenderOutput = size_t{1} << 20;

absl::Status CantDraw(const std::string& why) {
  return absl::InternalError(absl::StrCat("can't draw the figure: ", why));
}

absl::StatusOr<Drawn> ReadAnswer(const ProgramEnd& run) {
  const size_t end = run.output.find('\n');
  const Json answer = ParsedText(run.output.substr(0, end));
  if (run.exit_status != 0 || end == std::string::npos || !answer.is_object()) {
    const std::string error = run.LastError();
    return CantDraw(absl::StrCat("the drawing program ", run.HowItEnded(),
                                 error.empty() ? "" : ": ", Sanitized(error)));
  }
  if (answer.contains("error")) {
    const std::string sentence = Sanitized(answer.value("error", ""));
    if (answer.value("whose", "") == "caller") return absl::FailedPreconditionError(sentence);
    return absl::InternalError(sentence);
  }
  Drawn drawn = {answer.value("numbers", Json()), run.output.substr(end + 1)};
  if (drawn.file.size() != answer.value("bytes", size_t{0})) {
    return CantDraw("the drawing program stopped in the middle of the output");
  }
  return drawn;
}

constexpr size_t kMostMoments = 200;

absl::Status CheckNotStopped() {
  return StopRequested() ? absl::CancelledError("interrupted") : absl::OkStatus();
}

Json Slim(Json result) {
  for (const char* key : {"output", "limits", "comparison", "not_repeatable"}) result.erase(key);
  for (Json& row : result["episode_rows"]) {
    for (const char* key :
         {"log", "digest", "actions_digest", "wall_s", "policy_cpu_s", "attempt", "clipped"}) {
      row.erase(key);
    }
    if (row.value("fault", Json()).is_object()) row["fault"].erase("stderr_tail");
  }
  return result;
}

bool IsOfBoard(const Json& entry, const Json& board) {
  const auto same = [&](const char* key) {
    return entry.value(key, Json()) == board.value(key, Json());
  };
  return same("track") && same("profile") && same("phase");
}

// When something happened that may have changed a board, by the public record: oldest first; the
// first and the last are among them.
absl::StatusOr<std::vector<std::string>> MomentsOf(const Client& client, const Json& board) {
  std::set<int64_t> submissions;  // to the board
  std::set<std::string> found;
  for (int64_t from = 0, next = 0;; from = next) {
    RETURN_IF_ERROR(CheckNotStopped());
    ASSIGN_OR_RETURN(const Json page,
                     client.Get(absl::StrCat("/v1/record?limit=1000&from=", from)));
    for (const Json& row : page.value("entries", Json::array())) {
      const Json entry = row.value("entry", Json::object());
      const std::string kind = entry.value("kind", "");
      const int64_t submission = entry.value("submission", int64_t{0});
      if (kind == "accepted" && IsOfBoard(entry, board)) submissions.insert(submission);
      const bool of_all = kind == "team" || kind == "config" || kind == "rejudge";
      const bool of_one = kind == "graded" || kind == "marked" || kind == "chosen";
      if ((of_one && submissions.contains(submission)) || (of_all && !submissions.empty())) {
        found.insert(entry.value("at", ""));
      }
    }
    // Each page begins behind the one before, so that the loop ends.
    const Json further = page.value("next_from", Json());
    next = further.is_number_integer() ? further.get<int64_t>() : 0;
    if (next <= from) break;
  }
  std::vector<std::string> all(found.begin(), found.end());
  if (all.size() <= kMostMoments) return all;
  std::vector<std::string> some;
  for (size_t place = 0; place < kMostMoments; ++place) {
    some.push_back(all[place * (all.size() - 1) / (kMostMoments - 1)]);
  }
  return some;
}

// Of a board what a figure of its history shows.
Json RowsOfMoment(const Json& board) {
  Json rows = Json::array();
  for (const Json& row : board.value("rows", Json::array())) {
    rows.push_back({{"team", row.value("team", "")},
                    {"submission", row.value("submission", int64_t{0})},
                    {"baseline", row.value("baseline", false)},
                    {"aggregate", row.value("aggregate", Json::object())}});
  }
  return rows;
}

absl::Status AddMoments(const Client& client, BoardChoice then, Json& order) {
  ASSIGN_OR_RETURN(const std::vector<std::string> times, MomentsOf(client, order["board"]));
  ASSIGN_OR_RETURN(const Json challenges, client.Get("/v1/challenges"));
  Json moments = Json::array();
  Progress progress("board over time");
  int64_t done = 0;
  for (const std::string& at : times) {
    RETURN_IF_ERROR(CheckNotStopped());
    if (std::ssize(times) > 20) progress.Show(++done, std::ssize(times), "");
    then.at = at;
    ASSIGN_OR_RETURN(const Json board, client.Get("/v1/leaderboard" + then.Query()));
    Json rows = RowsOfMoment(board);
    // Nothing came or went: the board is as it was.
    if (!moments.empty() && moments.back()["rows"] == rows) continue;
    moments.push_back({{"at", at}, {"rows", std::move(rows)}});
  }
  moments.push_back({{"at", challenges.value("now", "")}, {"rows", RowsOfMoment(order["board"])}});
  order["moments"] = std::move(moments);
  return absl::OkStatus();
}

constexpr int kLookMilliseconds = 100;
constexpr size_t kMaxPngBytes = size_t{256} << 20;
constexpr absl::Duration kAfterDeadline = absl::Seconds(10);  // in which myograde-render says so itself

struct Received {
  const int fd;
  std::function<absl::Status(std::string_view)> take;
  bool open = true;
};

absl::Status ReceiveMore(Received& from) {
  char buffer[65536];
  while (from.open) {
    const ssize_t size = ::read(from.fd, buffer, sizeof(buffer));
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) {
      from.open = false;
      break;
    }
    RETURN_IF_ERROR(from.take({buffer, static_cast<size_t>(size)}));
  }
  return absl::OkStatus();
}

// Waits until all of `children` have ended and `from` is read to its end.
absl::Status AwaitAll(const std::vector<ChildProcess*>& children, Received& from,
                      double deadline_s) {
  const Deadline deadline(absl::Seconds(deadline_s) + kAfterDeadline);
  while (true) {
    if (StopRequested()) return absl::CancelledError("the drawing was interrupted");
    if (deadline.over()) {
      return absl::DeadlineExceededError(absl::StrCat("drawing took longer than ", deadline_s, " s"));
    }
    RETURN_IF_ERROR(ReceiveMore(from));
    bool ended = !from.open;
    std::vector<pollfd> fds;
    if (from.open) fds.push_back({from.fd, POLLIN, 0});
    for (ChildProcess* child : children) {
      ended = child->Look() && ended;
      if (child->err_fd() >= 0) fds.push_back({child->err_fd(), POLLIN, 0});
    }
    if (ended) return absl::OkStatus();
    ::poll(fds.data(), fds.size(), kLookMilliseconds);
  }
}

absl::StatusOr<ChildProcess> StartRenderer(const RenderOrder& order, const std::string& folder,
                                           Fd out) {
  ASSIGN_OR_RETURN(const std::string programs, BinDir());
  const std::string file = folder + "/order.json";
  if (absl::Status status = WriteFile(file, RenderOrderToJson(order).dump()); !status.ok()) {
    return absl::InternalError(status.message());
  }
  const Fd opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  const Fd in(::fcntl(opened.get(), F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
  if (!in.valid()) return absl::InternalError(absl::StrCat(file, ": can't be read again"));
  return ChildProcess::Start({.program = programs + "/myograde-render",
                              .words = {"myograde-render"},
                              .in = in.get(),
                              .out = out.get(),
                              .nice = kDrawingNice});
}

// What the end of myograde-render means.
absl::Status RenderStatus(const ChildProcess& renderer, const RenderOrder& order) {
  if (renderer.succeeded()) return absl::OkStatus();
  const int status = renderer.wait_status();
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM) {
    return absl::DeadlineExceededError(
        absl::StrCat("drawing took longer than ", order.deadline_s, " s"));
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == kRenderLogFault) {
    return absl::DataLossError(renderer.Failure());
  }
  return absl::InternalError(absl::StrCat("can't draw a picture: ", renderer.Failure()));
}

std::vector<std::string> EncoderWords(const RenderOrder& order, FilmFormat format,
                                      const std::string& path) {
  std::vector<std::string> words = {
      "ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", "-nostats",
      "-progress", "pipe:1",
      // What comes in: the pictures, one after the other.
      "-f", "rawvideo", "-pix_fmt", "rgb24",
      "-video_size", absl::StrCat(order.width, "x", order.height),
      "-framerate", absl::StrCat(order.frames_per_second), "-i", "pipe:0",
      // What goes out has no date or version in it.
      "-an", "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact",
      "-pix_fmt", "yuv420p"};
  const std::vector<std::string> codec =
      format == FilmFormat::kMp4
          ? std::vector<std::string>{"-c:v", "libx264",   "-preset",    "veryfast", "-crf",
                                     "20",   "-movflags", "+faststart", "-f",       "mp4"}
          : std::vector<std::string>{"-c:v",    "libvpx-vp9", "-b:v",     "0",         "-crf",
                                     "33",      "-deadline",  "realtime", "-cpu-used", "6",
                                     "-row-mt", "1",          "-f",       "webm"};
  words.insert(words.end(), codec.begin(), codec.end());
  words.insert(words.end(), {"-y", "file:" + path});
  return words;
}

absl::StatusOr<ChildProcess> StartEncoder(std::vector<std::string> words, Fd in, Fd out) {
  absl::StatusOr<std::string> program = FindProgram("ffmpeg");
  if (!program.ok()) {
    return absl::InternalError(absl::StrCat(
        "films need ffmpeg, and ", program.status().message(),
        ": install it (Debian: apt-get install ffmpeg), or write a .png"));
  }
  return ChildProcess::Start({.program = *program,
                              .words = std::move(words),
                              .in = in.get(),
                              .out = out.get(),
                              .nice = kDrawingNice});
}

}  // namespace

absl::StatusOr<Json> ResultForFigures(const Client& client, int64_t submission) {
  const std::string path = absl::StrCat("/v1/submissions/", submission, "/result");
  ASSIGN_OR_RETURN(Json result, EvaluationWithRows(client, path));
  return Slim(std::move(result));
}

absl::Status AddBoard(const Client& client, const BoardChoice& choice, Json& order) {
  ASSIGN_OR_RETURN(order["board"], client.Get("/v1/leaderboard" + choice.Query()));
  ASSIGN_OR_RETURN(order["statistics"], client.Get("/v1/leaderboard/statistics" + choice.Query()));
  return AddMoments(client, choice, order);
}

absl::Status AddWholeBoard(const Client& client, const BoardChoice& choice, Json& order) {
  RETURN_IF_ERROR(AddBoard(client, choice, order));
  ASSIGN_OR_RETURN(const Json challenges, client.Get("/v1/challenges"));
  order["phase"] = PhaseIn(challenges, TextAt(order["board"], "phase"));
  order["challenge"] = nullptr;
  for (const Json& challenge : challenges.value("challenges", Json::array())) {
    const Json phases = challenge.value("phases", Json::array());
    if (std::find(phases.begin(), phases.end(), order["phase"]) == phases.end()) continue;
    order["challenge"] = challenge.value("title", Json());
  }
  const Json rows = order["board"].value("rows", Json::array());
  Json results = Json::array();
  absl::Status refused;  // for every row alike
  Progress progress("results");
  int64_t done = 0;
  for (const Json& row : rows) {
    RETURN_IF_ERROR(CheckNotStopped());
    absl::StatusOr<Json> result =
        refused.ok() ? EvaluationWithRows(client, Filled(row, "/v1/evaluations/{evaluation}"))
                     : absl::StatusOr<Json>(refused);
    const std::string code = AnsweredCode(result.status());
    if (code == "forbidden" || code == "no_token" || code == "bad_token") refused = result.status();
    if (result.ok()) {
      results.push_back(Slim(*std::move(result)));
    } else if (absl::IsInvalidArgument(result.status())) {
      results.push_back({{"submission", row.value("submission", int64_t{0})},
                         {"team", row.value("team", "")},
                         {"name", row.value("name", "")},
                         {"error", std::string(result.status().message())}});
    } else {
      return result.status();
    }
    if (std::ssize(rows) > 20) progress.Show(++done, std::ssize(rows), "");
  }
  order["results"] = std::move(results);
  return absl::OkStatus();
}

absl::StatusOr<Drawn> DrawFigure(const Json& order) {
  // -I: neither the user's packages nor the environment change what is drawn.
  const absl::StatusOr<ProgramEnd> run =
      RunProgram({.program = kPython,
                  .words = {"-I", "-B", ShareDir() + "/figures"},
                  .input = order.dump(-1, ' ', false, Json::error_handler_t::replace),
                  .most_output = kMostDrawn,
                  .deadline = kDrawingTime,
                  .nice = kDrawingNice},
                 StopRequested);
  if (run.ok()) return ReadAnswer(*run);
  if (absl::IsCancelled(run.status())) return run.status();
  if (absl::IsDeadlineExceeded(run.status())) {
    return CantDraw(absl::StrCat("it took longer than ", absl::FormatDuration(kDrawingTime)));
  }
  return CantDraw(std::string(run.status().message()));
}

absl::Status CheckDrawing() {
  return DrawFigure({{"make", "nothing"}, {"format", "svg"}}).status();
}

absl::Status RunRender(std::vector<std::string> words) {
  words.insert(words.begin(), {"episode", "render"});
  const absl::StatusOr<ProgramEnd> run = RunProgram({.program = "myograde",
                                                     .words = std::move(words),
                                                     .most_output = kMostRenderOutput,
                                                     .deadline = kRenderTime,
                                                     .nice = kDrawingNice},
                                                    StopRequested);
  if (absl::IsCancelled(run.status())) return run.status();
  if (run.ok() && run->exit_status == 0) return absl::OkStatus();
  return absl::InternalError(absl::StripPrefix(Sanitized(WhyItFailed(run)), "myograde: error: "));
}

absl::StatusOr<int> DrawInto(const std::string& file, const absl::Status& gathered,
                             const Json& order, Json head, bool json) {
  const absl::StatusOr<Drawn> drawn = gathered.ok() ? DrawFigure(order) : gathered;
  if (absl::IsCancelled(drawn.status())) {
    PrintToErrors("myograde: interrupted; nothing was written");
    return kNoScore;
  }
  if (!drawn.ok()) return drawn.status();
  head["file"] = TextOrNull(file);
  head["bytes"] = nullptr;
  head["sha256"] = nullptr;
  if (!file.empty()) {
    ASSIGN_OR_RETURN(head["sha256"], WriteNewFile(file, drawn->file, kFigureMode));
    head["bytes"] = drawn->file.size();
  }
  head["numbers"] = drawn->numbers;
  return PrintAnswer(head, json, Sentence("{file}: {bytes:byte}"));
}

absl::StatusOr<std::string> DrawPng(const RenderOrder& order, const std::string& folder) {
  CatchStopSignals();
  ASSIGN_OR_RETURN(Pipe pictures, MakeOutputPipe());
  ASSIGN_OR_RETURN(ChildProcess renderer, StartRenderer(order, folder, std::move(pictures.write)));
  std::string png;
  Received from = {pictures.read.get(), [&](std::string_view piece) {
                     png.append(piece);
                     if (png.size() <= kMaxPngBytes) return absl::OkStatus();
                     return absl::InternalError("the picture is larger than 256 MiB");
                   }};
  RETURN_IF_ERROR(AwaitAll({&renderer}, from, order.deadline_s));
  RETURN_IF_ERROR(RenderStatus(renderer, order));
  return png;
}

absl::Status EncodeFilm(const RenderOrder& order, FilmFormat format, const std::string& folder,
                        const std::string& path, const std::function<void(int64_t)>& progress) {
  CatchStopSignals();
  ASSIGN_OR_RETURN(Pipe pictures, MakePipe());
  ASSIGN_OR_RETURN(Pipe said, MakeOutputPipe());
  ASSIGN_OR_RETURN(ChildProcess encoder,
                   StartEncoder(EncoderWords(order, format, path), std::move(pictures.read),
                                std::move(said.write)));
  ASSIGN_OR_RETURN(ChildProcess renderer, StartRenderer(order, folder, std::move(pictures.write)));
  std::string lines;  // of ffmpeg, "frame=12" among them
  Received from = {said.read.get(), [&](std::string_view piece) {
                     lines.append(piece);
                     for (size_t end; (end = lines.find('\n')) != std::string::npos;) {
                       int64_t frame = 0;
                       const std::string line = lines.substr(0, end);
                       lines.erase(0, end + 1);
                       if (line.starts_with("frame=") && absl::SimpleAtoi(line.substr(6), &frame)) {
                         progress(frame);
                       }
                     }
                     return absl::OkStatus();
                   }};
  RETURN_IF_ERROR(AwaitAll({&renderer, &encoder}, from, order.deadline_s));
  const absl::Status drawn = RenderStatus(renderer, order);
  // Without its reader the renderer can't go on, and it was not its fault.
  const bool unread = WIFSIGNALED(renderer.wait_status()) &&
                      WTERMSIG(renderer.wait_status()) == SIGPIPE;
  if (!drawn.ok() && !unread) return drawn;
  if (encoder.succeeded() && drawn.ok()) return absl::OkStatus();
  return absl::InternalError(absl::StrCat("ffmpeg can't encode the film: ", encoder.Failure()));
}

}  // namespace myograde::server
