#include "server/cli/offline/draw.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/strip.h>
#include <absl/time/time.h>

#include <algorithm>
#include <set>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/files.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/terminal/progress.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";
constexpr absl::Duration kDrawingTime = absl::Minutes(10);
constexpr size_t kMostDrawn = size_t{512} << 20;
constexpr mode_t kFigureMode = 0644;
constexpr int kDrawingNice = 10;
constexpr absl::Duration kRenderTime = absl::Hours(24);  // "render" has a deadline of its own
constexpr size_t kMostRenderOutput = size_t{1} << 20;

absl::Status CantDraw(const std::string& why) {
  return absl::InternalError(absl::StrCat("the figure could not be drawn: ", why));
}

absl::StatusOr<Drawn> ReadAnswer(const ProgramEnd& run) {
  const size_t end = run.output.find('\n');
  const Json answer = Json::parse(run.output.substr(0, end), nullptr, /*allow_exceptions=*/false);
  if (run.exit_status != 0 || end == std::string::npos || !answer.is_object()) {
    const std::string error = run.LastError();
    return CantDraw(absl::StrCat("the drawing program ", run.HowItEnded(),
                                 error.empty() ? "" : ": ", Harmless(error)));
  }
  if (answer.contains("error")) {
    const std::string sentence = Harmless(answer.value("error", ""));
    if (answer.value("whose", "") == "caller") return absl::FailedPreconditionError(sentence);
    return absl::InternalError(sentence);
  }
  Drawn drawn = {answer.value("numbers", Json()), run.output.substr(end + 1)};
  if (drawn.file.size() != answer.value("bytes", size_t{0})) {
    return CantDraw("the drawing program printed only a part of it");
  }
  return drawn;
}

constexpr size_t kMostMoments = 200;
// Refusals that hold for every row alike.
constexpr const char* kRefusesAll[] = {"forbidden", "no_token", "bad_token"};

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
  return entry.value("track", Json()) == board.value("track", Json()) &&
         entry.value("profile", Json()) == board.value("profile", Json()) &&
         entry.value("phase", Json()) == board.value("phase", Json());
}

// When something happened that may have changed a board, from the entries of the public record in
// their order.
class BoardChanges {
 public:
  explicit BoardChanges(const Json& board) : board_(board) {}

  void Take(const Json& entry) {
    const std::string kind = entry.value("kind", "");
    const int64_t submission = entry.value("submission", int64_t{0});
    if (kind == "accepted" && IsOfBoard(entry, board_)) submissions_.insert(submission);
    const bool of_board = submissions_.contains(submission);
    const bool of_all = kind == "team" || kind == "config" || kind == "rejudge";
    const bool changes = kind == "graded" || kind == "marked" || kind == "chosen";
    if ((changes && of_board) || (of_all && !submissions_.empty())) {
      moments_.insert(entry.value("at", ""));
    }
  }

  // Oldest first; the first and the last are among them.
  std::vector<std::string> Moments() const {
    const std::vector<std::string> all(moments_.begin(), moments_.end());
    if (all.size() <= kMostMoments) return all;
    std::vector<std::string> some;
    for (size_t place = 0; place < kMostMoments; ++place) {
      some.push_back(all[place * (all.size() - 1) / (kMostMoments - 1)]);
    }
    return some;
  }

 private:
  const Json& board_;
  std::set<int64_t> submissions_;
  std::set<std::string> moments_;
};

absl::StatusOr<std::vector<std::string>> MomentsOf(const Client& client, const Json& board) {
  BoardChanges changes(board);
  for (int64_t from = 0;;) {
    RETURN_IF_ERROR(CheckNotStopped());
    ASSIGN_OR_RETURN(const Json page,
                     client.Get(absl::StrCat("/v1/record?limit=1000&from=", from)));
    for (const Json& row : page.value("entries", Json::array())) {
      changes.Take(row.value("entry", Json::object()));
    }
    const Json next = page.value("next_from", Json());
    // Each page begins behind the one before, so that the loop ends.
    if (!next.is_number_integer() || next.get<int64_t>() <= from) return changes.Moments();
    from = next.get<int64_t>();
  }
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

bool RefusesAll(const absl::Status& status) {
  return std::any_of(std::begin(kRefusesAll), std::end(kRefusesAll),
                     [&](const char* code) { return AnsweredCode(status) == code; });
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
  absl::Status refused;
  Progress progress("results");
  int64_t done = 0;
  for (const Json& row : rows) {
    RETURN_IF_ERROR(CheckNotStopped());
    absl::StatusOr<Json> result =
        refused.ok() ? EvaluationWithRows(client, Filled(row, "/v1/evaluations/{evaluation}"))
                     : absl::StatusOr<Json>(refused);
    if (RefusesAll(result.status())) refused = result.status();
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

absl::Status RunRender(std::vector<std::string> words) {
  words.insert(words.begin(), "render");
  const absl::StatusOr<ProgramEnd> run = RunProgram({.program = "myograde",
                                                     .words = std::move(words),
                                                     .most_output = kMostRenderOutput,
                                                     .deadline = kRenderTime,
                                                     .nice = kDrawingNice},
                                                    StopRequested);
  if (absl::IsCancelled(run.status())) return run.status();
  if (run.ok() && run->exit_status == 0) return absl::OkStatus();
  return absl::InternalError(absl::StripPrefix(Harmless(WhyItFailed(run)), "myograde: error: "));
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

}  // namespace myograde::server
