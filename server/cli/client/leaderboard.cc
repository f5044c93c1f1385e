// Boards: myograde leaderboard; phase: pause, resume, publish; evaluate: further episodes for
// places that are close
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

// "Leaderboard of TRACK, profile P, phase X, board main, 100 episodes"; `as_of`, which only phases
// have, stands behind the phase.
void PrintHead(const char* what, const Json& answer, const std::string& as_of,
               const std::string& moment) {
  std::cout << Bold(absl::StrCat(
                   what, Filled(answer, " of {track}, profile {profile}[, phase {phase}]"), as_of,
                   Filled(answer, ", board {board}, {episodes:episode}"), moment))
            << '\n';
}

std::string RankText(const Json& row) {
  return row.value("baseline", false) ? "base" : Cell(row, "rank");
}

constexpr int kMostDigits = 9;

// "0.310 [0.228, 0.406]".
std::string IntervalCell(const Json& row, const Json& criterion) {
  const Json interval =
      row.value("intervals", Json::object()).value(criterion.value("name", ""), Json());
  if (!interval.is_object()) return "-";
  const int digits = std::clamp(criterion.value("digits", 4), 0, kMostDigits);
  return absl::StrCat(Cell(interval, "value", digits), " [", Cell(interval, "low", digits), ", ",
                      Cell(interval, "high", digits), "]");
}

// The p-value of a test, as corrected: that is what is compared with the level.
std::string TestCell(const Json& row, const char* key) {
  const Json test = row.value(key, Json());
  if (!test.is_object()) return "-";
  const double p = test.value("p_adjusted", 1.0);
  return absl::StrCat(p < 1e-4 ? absl::StrFormat("%.1e", p) : absl::StrFormat("%.4f", p),
                      test.value("decided", false) ? " *" : "",
                      test.value("reversed", false) ? " reversed" : "");
}

void PrintPlaces(const Json& answer) {
  const Json rows = answer.value("rows", Json::array());
  std::vector<RowColumn> columns = {RowColumn("rank", RankText), "group", "team", "policy=name",
                                    "id=submission"};
  for (const Json& criterion : answer.value("criteria", Json::array())) {
    columns.push_back({Cell(criterion, "title"),
                       [criterion](const Json& row) { return IntervalCell(row, criterion); }});
  }
  columns.push_back("faults=participant_faults");
  columns.push_back({"p (above)", [](const Json& row) { return TestCell(row, "above"); }});
  columns.push_back({"p (group)", [](const Json& row) { return TestCell(row, "opener"); }});
  if (std::any_of(rows.begin(), rows.end(),
                  [](const Json& row) { return row.value("further_episodes", int64_t{0}) > 0; })) {
    columns.push_back("further=further_episodes");
  }
  PrintRows(rows, columns);
}

void PrintMeaning(const Json& answer) {
  const Json used = answer.value("statistics", Json::object());
  std::cout << Filled(
                   used,
                   "  Intervals are 95 %. p: paired permutation test over the same episodes, "
                   "corrected (Holm) for {tests:test} of the first {places} places; * decides at "
                   "the level ")
            << absl::StrCat(used.value("level", 0.0)) << ".\n";
  if (used.value("spending", Json()) == "halving") {
    std::cout
        << "  Further episodes are another look at the data: the first look at a pair may spend "
           "half of the level, each later one half of what is left.\n";
  }
  if (answer.value("undecided", int64_t{0}) > 0) {
    std::cout << Filled(answer, "  {undecided:place} share a group: these episodes do not "
                                "separate them.\n");
  }
  if (used.value("ranks", "") == "groups") std::cout << "  Ranks are the ranks of the groups.\n";
}

void PrintStatistics(const Json& answer) {
  PrintHead("Statistics", answer, "", "");
  if (answer.value("rows", Json::array()).empty()) {
    std::cout << "  The board is empty: only whole evaluations rank.\n";
  } else {
    PrintPlaces(answer);
    PrintMeaning(answer);
  }
  if (!answer.value("complete", true)) {
    std::cout << Filled(answer,
                        "  The board is frozen as of {frozen_at}: later results do not count "
                        "yet.\n");
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

// Marks a row that another build played than most of its board.
constexpr char kOtherBuild[] = "*";

// Enough of a hash to ask for a board by.
std::string ShortHash(const Json& of, const char* key) {
  return HashText(Cell(of, key), /*full=*/false);
}

struct BoardOptions : DaemonOptions {
  BoardChoice board;
  std::string above;  // of "board explain": two rows, in any order
  std::string below;
  bool statistics = false;
};

// What makes it another board than that of now.
std::string MomentOf(const Json& board) {
  std::string moment = Filled(board, "[, as it was at {at}]");
  if (Cell(board, "config") != Cell(board, "config_in_force")) {
    absl::StrAppend(&moment, ", under the config ", ShortHash(board, "config"));
  }
  return moment;
}

// What other builds of the grader played, and what stands under other configs.
void PrintOthers(const Json& board) {
  const Json builds = board.value("builds", Json::array());
  for (const Json& build : builds) {
    if (&build == &builds.front()) continue;
    std::cout << "  " << kOtherBuild
              << Filled(build, " {rows:row} played by the build {build}, the others by ")
              << Filled(builds.front(), "{build}: builds may differ in results\n");
  }
  if (const auto others = board.value("other_config", int64_t{0}); others > 0) {
    std::cout << Filled(board, "  {other_config:evaluation} under an earlier config of this track ")
              << (others == 1 ? "is not on it.\n" : "are not on it.\n");
  }
  for (const Json& other : board.value("other_configs", Json::array())) {
    const std::string hash = ShortHash(other, "config");
    std::cout << (other.value("in_force", false) ? "  Under the config in force, "
                                                 : "  Under the config ")
              << hash
              << Filled(other,
                        ": {submissions:submission} of {teams:team}, accepted from {from} to "
                        "{to}; see it with --config ")
              << hash << '\n';
  }
}

void PrintRanking(const Json& board, const Json& rows) {
  const auto id = [](const Json& row) {
    return absl::StrCat(Cell(row, "submission"),
                        row.value("other_build", false) ? kOtherBuild : "");
  };
  std::vector<RowColumn> columns = {RowColumn("rank", RankText), "team", "policy=name",
                                    RowColumn("id", id), "success={aggregate.successes}"};
  for (const RowColumn& metric : MetricColumns(board.value("columns", Json::array()))) {
    columns.push_back(ColumnOfPart("aggregate", metric));
  }
  PrintRows(rows, columns);
  if (RowWith(rows, "baseline", true).is_object()) {
    std::cout << "  base: a baseline of the organiser, shown for comparison\n";
  }
  std::cout << Filled(board, "[  {order}\n]");
}

void PrintBoard(const Json& board) {
  PrintHead("Leaderboard", board,
            board.value("complete", true) ? "" : Filled(board, ", as of {frozen_at}"),
            MomentOf(board));
  const Json rows = board.value("rows", Json::array());
  if (rows.empty()) {
    std::cout << "  It is empty: only whole evaluations rank.\n";
  } else {
    PrintRanking(board, rows);
  }
  for (const Json& row : board.value("disqualified", Json::array())) {
    std::cout << Filled(row,
                        "  Disqualified: submission {submission} of {team} ({name}): {reason}\n");
  }
  if (board.value("frozen_at", Json()).is_string()) {
    std::cout << (board.value("complete", true)
                      ? "  It is frozen for everybody but organisers; \"myograde phase publish\" "
                        "unfreezes it.\n"
                      : "  It is frozen: later results are not on it yet.\n");
  }
  PrintUnreadable(board);
  PrintOthers(board);
  std::cout.flush();
}

absl::StatusOr<int> Explain(BoardOptions options) {
  BoardChoice& board = options.board;
  int64_t id = 0;
  if (!board.named() && absl::SimpleAtoi(options.above, &id)) {
    ASSIGN_OR_RETURN(const Json submission,
                     options.client().Get(absl::StrCat("/v1/submissions/", id)));
    board.track = submission.value("track", "");
    if (board.profile.empty()) board.profile = submission.value("profile", "");
    board.phase = TextAt(submission, "phase");
  }
  RETURN_IF_ERROR(RefuseIf(
      {{!board.named(), "two teams are compared on one board: give --track or --phase"}}));
  return options.GetAndPrint(
      absl::StrCat("/v1/leaderboard/explain", board.Query(), "&a=",
                   QueryValue(options.above), "&b=", QueryValue(options.below)),
      [](const Json& answer) { std::cout << Sanitized(answer.value("why", "")) << std::endl; });
}

absl::StatusOr<int> AllBoards(BoardOptions options) {
  const Client client = options.client();
  const BoardChoice& wanted = options.board;
  ASSIGN_OR_RETURN(const Json tracks, client.Get("/v1/tracks"));
  Json boards = Json::array();
  for (const Json& track : tracks.value("tracks", Json::array())) {
    // Asked for by name, a profile or board that a track lacks is a mistake; here it is skipped.
    const Json names = track.value("boards", Json::array());
    if (std::find(names.begin(), names.end(), wanted.board) == names.end()) continue;
    const Json profiles = track.value("profiles", Json::array());
    if (!wanted.profile.empty() && RowWith(profiles, "profile", wanted.profile).is_null()) continue;
    options.board.track = track.value("track", "");
    ASSIGN_OR_RETURN(Json board, client.Get("/v1/leaderboard" + wanted.Query()));
    boards.push_back(std::move(board));
  }
  if (boards.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("no track has a board \"", wanted.board,
                                                   "\" in the profile \"", wanted.profile, "\""));
  }
  return PrintAnswer(Json{{"leaderboards", boards}}, options.json, [&](const Json&) {
    for (const Json& board : boards) {
      if (&board != &boards.front()) std::cout << '\n';
      PrintBoard(board);
    }
  });
}

absl::StatusOr<int> Leaderboard(const BoardOptions& options) {
  RETURN_IF_ERROR(RefuseIf({{options.statistics && !options.board.named(),
                             "--statistics covers one board: give --track, --phase or --config"}}));
  if (options.statistics) {
    return options.GetAndPrint("/v1/leaderboard/statistics" + options.board.Query(),
                               PrintStatistics);
  }
  if (!options.board.named()) return AllBoards(options);
  return options.GetAndPrint("/v1/leaderboard" + options.board.Query(), PrintBoard);
}

struct PhaseOptions : DaemonOptions {
  std::string name;
  std::string reason;
  bool all = false;
};

void PrintAct(const Json& answer) {
  const bool all = answer.value("phase", Json()).is_null();
  const std::string event = Cell(answer, "event");
  const bool changed = answer.value("changed", false);
  std::cout << Filled(answer, all ? "Submissions are " : "Phase {phase} is ")
            << (event == "resumed" ? (changed ? "no longer paused" : "not paused")
                                   : (changed ? "now " : "already ") + event)
            << (changed ? "." : "; nothing changed.");
  if (event == "resumed" && Cell(answer, "state") == "paused") {
    std::cout << " It stays paused, as all submissions are.";
  }
  std::cout << std::endl;
}

// `act`: "pause", "resume" or "publish".
absl::StatusOr<int> ActOnPhase(const PhaseOptions& options, const std::string& act) {
  RETURN_IF_ERROR(RefuseIf({{options.all == !options.name.empty(),
                             "give one phase, or --all for all submissions"}}));
  const std::string of = options.all ? "" : absl::StrCat("phases/", QueryValue(options.name), "/");
  return options.PostAndPrint(absl::StrCat("/v1/", of, act), {{"reason", options.reason}},
                              PrintAct);
}

struct EvaluateOptions : DaemonOptions {
  std::string phase;
  std::string board = "main";
  int64_t more_seeds = 0;
  std::string places;  // "A..B", or "" for all that are undecided
  std::string reason = "close places";
  bool wait = false;
};

absl::StatusOr<Json> PlacesOf(const std::string& text) {
  const auto range = ParseRange(text);
  if (range.has_value() && range->first >= 1 && range->second > range->first) {
    return Json{range->first, range->second};
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--places: \"", Sanitized(text), "\" is not two ranks as in 2..4"));
}

void PrintFurther(const Json& answer) {
  for (const Json& rejudge : answer.value("rejudges", Json::array())) {
    const Json submissions = rejudge.value("submissions", Json::array());
    std::cout << Filled(rejudge, "Rejudge {rejudge} plays {episodes:further episode} of ")
              << Counted(std::ssize(submissions), "submission") << ":";
    for (const Json& submission : submissions) std::cout << ' ' << submission;
    std::cout << "\n";
    const Json lost = rejudge.value("without_files", Json::array());
    if (!lost.empty()) {
      std::cout << "  The files of " << Counted(std::ssize(lost), "submission")
                << " are no longer on this host, so no further episodes are played.\n";
    }
  }
  std::cout << Filled(answer, "No rank by the rules changes. Once they have ended, \"myograde "
                              "leaderboard --phase {phase} --statistics\" includes them.")
            << std::endl;
}

absl::StatusOr<int> Evaluate(const EvaluateOptions& options) {
  Json body = {
      {"episodes", options.more_seeds}, {"board", options.board}, {"reason", options.reason}};
  if (!options.places.empty()) {
    ASSIGN_OR_RETURN(body["places"], PlacesOf(options.places));
  }
  const Client client = options.client();
  ASSIGN_OR_RETURN(
      const Json asked,
      client.Post(absl::StrCat("/v1/phases/", QueryValue(options.phase), "/more-seeds"), body));
  // Until all of them have been played, or were dropped.
  for (const Json& rejudge : options.wait ? asked.value("rejudges", Json()) : Json()) {
    RETURN_IF_ERROR(FollowUntil(client, Filled(rejudge, "/v1/rejudges/{rejudge}"),
                                Filled(rejudge, "rejudge {rejudge}"),
                                [](const Json& now) {
                                  return now.value("complete", false) ||
                                         now.value("state", "") == "dropped";
                                })
                        .status());
  }
  return PrintAnswer(asked, options.json, PrintFurther);
}

void AddBoardOfAMoment(CLI::App& verb, BoardOptions& options, const std::string& track_help) {
  AddBoardChoice(verb, options.board, track_help,
                 "Phase of a challenge, open or over (default: the track's own board)");
  verb.add_option("--at", options.board.at,
                  "The board as it was at this moment, such as 2026-12-01T12:00:00Z");
}

}  // namespace

Command AddLeaderboard(CLI::App& verb) {
  auto options = std::make_shared<BoardOptions>();
  AddBoardOfAMoment(verb, *options, "Name of the track (default: all)");
  verb.add_flag("--statistics", options->statistics,
                "Show which ranks the episodes separate: groups, intervals and faults");
  AddDaemonOptions(verb, "leaderboard", *options);
  return [options] { return Leaderboard(*options); };
}

Command AddExplain(CLI::App& verb) {
  auto options = std::make_shared<BoardOptions>();
  for (const auto& [name, row] : {std::pair{"A", &options->above}, std::pair{"B", &options->below}}) {
    verb.add_option(name, *row, "A submission or a team")->required()->type_name("TEXT");
  }
  AddBoardOfAMoment(verb, *options, "Name of the track (default: that of the submissions)");
  AddDaemonOptions(verb, "leaderboard", *options);
  return [options] { return Explain(*options); };
}

Command AddRebuild(CLI::App& verb) {
  auto options = std::make_shared<DaemonOptions>();
  AddDaemonOptions(verb, "leaderboard", *options);
  return [options] {
    return options->PostAndPrint("/v1/leaderboard/rebuild", Json::object(), [](const Json& answer) {
      std::cout << Filled(answer,
                          "The boards were rebuilt from the episodes of {rebuilt:evaluation}.\n");
      PrintUnreadable(answer);
    });
  };
}

Command AddPhase(CLI::App& verb) {
  DaemonParts<PhaseOptions> parts(verb);
  const auto add = [&](const std::string& name, const char* does, const char* example, bool all) {
    CLI::App* part = parts.Add(name, does, example, "phase", [name](const PhaseOptions& options) {
      return ActOnPhase(options, name);
    });
    part->add_option("NAME", parts.options().name,
                     "Name of the phase, as \"myograde phase status\" lists it");
    part->add_option("--reason", parts.options().reason,
                     "Reason, shown to participants and kept in the record; up to 200 bytes")
        ->required();
    if (!all) return;
    part->add_flag("--all", parts.options().all, "All submissions, of every track and phase");
  };
  add("pause", "Refuse new submissions; those accepted are still evaluated",
      "pause final --reason \"a slot is broken\"", /*all=*/true);
  add("resume", "Accept submissions again", "resume final --reason \"it is repaired\"",
      /*all=*/true);
  add("publish", "Show everybody the frozen board and what the phase withheld; can't be undone",
      "publish final --reason \"closing ceremony\"", /*all=*/false);
  return {};
}

Command AddEvaluate(CLI::App& verb) {
  auto options = std::make_shared<EvaluateOptions>();
  verb.add_option("--phase", options->phase, "The phase with close ranks")->required();
  verb.add_option("--more-seeds", options->more_seeds,
                  "Further episodes of each submission in total, on seeds after the phase's own")
      ->required()
      ->type_name("N");
  verb.add_option("--places", options->places,
                  "First and last rank (default: all that share a group)")
      ->type_name("A..B");
  verb.add_option("--board", options->board, "Name of the board (default: main)");
  verb.add_option("--reason", options->reason,
                  "Why, for the record; up to 200 bytes (default: \"close places\")");
  verb.add_flag("--wait", options->wait, "Wait until they have been played");
  AddDaemonOptions(verb, "evaluate", *options);
  return [options] { return Evaluate(*options); };
}

}  // namespace myograde::server
