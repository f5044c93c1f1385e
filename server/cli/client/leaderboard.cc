// myograde leaderboard
#include <algorithm>
#include <iostream>
#include <memory>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/report.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/leaderboard_statistics.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Marks a row that another build played than most of its board.
constexpr char kOtherBuild[] = "*";
constexpr size_t kShortHash = 12;

// Enough of a hash to ask for a board by.
std::string ShortHash(const Json& of, const char* key) {
  return Cell(of, key).substr(0, kShortHash);
}

struct BoardOptions : DaemonOptions {
  std::string track;
  std::string profile;
  std::string phase;
  std::string board = "main";
  std::string config;  // the hash, or its first digits
  std::string at;
  std::vector<std::string> explain;  // two rows, or none
  bool statistics = false;
  bool rebuild = false;
};

// The phase of a board, and the time that it is of.
std::string PhaseOf(const Json& board) {
  if (!board.value("phase", Json()).is_string()) return "";
  const bool frozen = !board.value("complete", true);
  return absl::StrCat(", phase ", Cell(board, "phase"),
                      frozen ? absl::StrCat(", as of ", Cell(board, "frozen_at")) : "");
}

// What makes it another board than that of now.
std::string MomentOf(const Json& board) {
  std::string moment;
  if (board.value("at", Json()).is_string()) {
    moment = absl::StrCat(", as it was at ", Cell(board, "at"));
  }
  if (Cell(board, "config") != Cell(board, "config_in_force")) {
    absl::StrAppend(&moment, ", under the config ", ShortHash(board, "config"));
  }
  return moment;
}

void PrintHead(const Json& board) {
  std::cout << Bold(absl::StrCat("Leaderboard of ", Cell(board, "track"), ", profile ",
                                 Cell(board, "profile"), PhaseOf(board), ", board ",
                                 Cell(board, "board"), ", ",
                                 CountCell(board, "episodes", "episode"), MomentOf(board)))
            << '\n';
}

// What other builds of the grader played, and what stands under other configs.
void PrintOthers(const Json& board) {
  const Json builds = board.value("builds", Json::array());
  for (const Json& build : builds) {
    if (&build == &builds.front()) continue;
    std::cout << "  " << kOtherBuild << " " << CountCell(build, "rows", "row")
              << " played by the build " << Cell(build, "build") << ", the others by "
              << Cell(builds.front(), "build") << ": builds may differ in results\n";
  }
  if (const auto others = board.value("other_config", int64_t{0}); others > 0) {
    std::cout << "  " << Counted(others, "evaluation")
              << " under an earlier config of this track " << (others == 1 ? "is" : "are")
              << " not on it.\n";
  }
  for (const Json& other : board.value("other_configs", Json::array())) {
    const bool in_force = other.value("in_force", false);
    std::cout << "  Under " << (in_force ? "the config in force, " : "the config ")
              << ShortHash(other, "config") << ": " << CountCell(other, "submissions", "submission")
              << " of " << CountCell(other, "teams", "team") << ", accepted from "
              << Cell(other, "from") << " to " << Cell(other, "to") << "; see it with --config "
              << ShortHash(other, "config") << '\n';
  }
}

void PrintBoard(const Json& board) {
  PrintHead(board);
  const Json rows = board.value("rows", Json::array());
  const auto aggregate_of = [](const Json& row) { return row.value("aggregate", Json::object()); };
  if (rows.empty()) {
    std::cout << "  It is empty: only whole evaluations rank.\n";
  } else {
    const std::vector<MetricColumn> columns = MetricColumns(board.value("columns", Json::array()));
    std::vector<std::string> head = {"rank", "team", "policy", "id", "success"};
    for (const MetricColumn& column : columns) head.push_back(column.title);
    Table table(std::move(head));
    bool baselines = false;
    for (const Json& row : rows) {
      const Json aggregate = aggregate_of(row);
      const bool baseline = row.value("baseline", false);
      baselines = baselines || baseline;
      std::vector<std::string> cells = {baseline ? "base" : Cell(row, "rank"),
                                        Cell(row, "team"), Cell(row, "name"),
                                        Cell(row, "submission"), Cell(aggregate, "successes")};
      if (row.value("other_build", false)) cells[3] += kOtherBuild;
      for (const MetricColumn& column : columns) {
        cells.push_back(Cell(aggregate, column.key, column.digits));
      }
      table.Add(std::move(cells));
    }
    table.Print();
    if (baselines) std::cout << "  base: a baseline of the organiser, shown for comparison\n";
    if (const std::string order = Cell(board, "order"); order != "-") {
      std::cout << "  " << order << '\n';
    }
  }
  for (const Json& row : board.value("disqualified", Json::array())) {
    std::cout << "  Disqualified: submission " << Cell(row, "submission") << " of "
              << Cell(row, "team") << " (" << Cell(row, "name") << "): " << Cell(row, "reason")
              << '\n';
  }
  if (board.value("frozen_at", Json()).is_string()) {
    std::cout << (board.value("complete", true)
                      ? "  It is frozen for everybody but organisers; \"myograde phase publish\" ends "
                        "that.\n"
                      : "  It is frozen: what ended later is not on it yet.\n");
  }
  PrintUnreadable(board);
  PrintOthers(board);
  std::cout.flush();
}

std::string QueryOf(const BoardOptions& options, const std::string& track) {
  std::string query = track.empty() ? "?" : absl::StrCat("?track=", QueryValue(track), "&");
  absl::StrAppend(&query, "board=", QueryValue(options.board));
  if (!options.phase.empty()) absl::StrAppend(&query, "&phase=", QueryValue(options.phase));
  if (!options.profile.empty()) absl::StrAppend(&query, "&profile=", QueryValue(options.profile));
  if (!options.config.empty()) absl::StrAppend(&query, "&config=", QueryValue(options.config));
  if (!options.at.empty()) absl::StrAppend(&query, "&at=", QueryValue(options.at));
  return query;
}

absl::StatusOr<Json> BoardOf(const Client& client, const BoardOptions& options,
                             const std::string& track) {
  return client.Get("/v1/leaderboard" + QueryOf(options, track));
}

int Explain(const Client& client, BoardOptions options) {
  int64_t id = 0;
  const bool board_known =
      !options.track.empty() || !options.phase.empty() || !options.config.empty();
  if (!board_known && absl::SimpleAtoi(options.explain.front(), &id)) {
    const absl::StatusOr<Json> submission = client.Get(absl::StrCat("/v1/submissions/", id));
    if (!submission.ok()) return ReportError(submission.status());
    options.track = submission->value("track", "");
    if (options.profile.empty()) options.profile = submission->value("profile", "");
    const Json phase = submission->value("phase", Json());
    if (options.phase.empty() && phase.is_string()) options.phase = phase.get<std::string>();
  }
  if (options.track.empty() && options.phase.empty() && options.config.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "teams are compared on one board: give --track or --phase"));
  }
  const std::string path = absl::StrCat(
      "/v1/leaderboard/explain", QueryOf(options, options.track), "&a=",
      QueryValue(options.explain.front()), "&b=", QueryValue(options.explain.back()));
  return PrintAnswer(client.Get(path), options.json, [](const Json& answer) {
    std::cout << Harmless(answer.value("why", "")) << std::endl;
  });
}

int Rebuild(const Client& client, bool json) {
  const absl::StatusOr<Json> rebuilt = client.Post("/v1/leaderboard/rebuild", Json::object());
  return PrintAnswer(rebuilt, json, [](const Json& answer) {
    std::cout << "The boards were rebuilt from the episodes of "
              << CountCell(answer, "rebuilt", "evaluation") << "." << std::endl;
    PrintUnreadable(answer);
  });
}

int Statistics(const Client& client, const BoardOptions& options) {
  if (options.track.empty() && options.phase.empty() && options.config.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "--statistics are of one board: give --track, --phase or --config"));
  }
  return PrintAnswer(client.Get("/v1/leaderboard/statistics" + QueryOf(options, options.track)),
                     options.json, PrintStatistics);
}

int AllBoards(const Client& client, const BoardOptions& options) {
  const absl::StatusOr<Json> tracks = client.Get("/v1/tracks");
  if (!tracks.ok()) return ReportError(tracks.status());
  Json boards = Json::array();
  for (const Json& track : tracks->value("tracks", Json::array())) {
    // Asked for by name, a profile or board that a track lacks is a mistake; here it is skipped.
    const Json names = track.value("boards", Json::array());
    if (std::find(names.begin(), names.end(), options.board) == names.end()) continue;
    bool has_profile = options.profile.empty();
    for (const Json& profile : track.value("profiles", Json::array())) {
      has_profile |= profile.value("profile", "") == options.profile;
    }
    if (!has_profile) continue;
    absl::StatusOr<Json> board = BoardOf(client, options, track.value("track", ""));
    if (!board.ok()) return ReportError(board.status());
    boards.push_back(*std::move(board));
  }
  if (boards.empty()) {
    return ReportError(absl::InvalidArgumentError(absl::StrCat(
        "no track has a board \"", options.board, "\" in the profile \"", options.profile, "\"")));
  }
  if (options.json) {
    PrintJson({{"leaderboards", boards}});
    return kDone;
  }
  for (const Json& board : boards) {
    if (&board != &boards.front()) std::cout << '\n';
    PrintBoard(board);
  }
  return kDone;
}

int Leaderboard(const BoardOptions& options) {
  const Client client = options.client();
  if (options.rebuild) return Rebuild(client, options.json);
  if (!options.explain.empty()) return Explain(client, options);
  const bool named =
      !options.track.empty() || !options.phase.empty() || !options.config.empty();
  if (options.statistics) return Statistics(client, options);
  if (!named) return AllBoards(client, options);
  return PrintAnswer(BoardOf(client, options, options.track), options.json, PrintBoard);
}

}  // namespace

Action AddLeaderboard(CLI::App& verb) {
  auto options = std::make_shared<BoardOptions>();
  verb.add_option("--track", options->track, "Name of the track (default: all)");
  verb.add_option("--profile", options->profile, "Rules profile (default: the track's own)");
  verb.add_option("--phase", options->phase,
                  "Phase of a challenge, also of one that is over (default: the track's own board)");
  verb.add_option("--board", options->board, "Name of the board (default: main, which all have)");
  verb.add_option("--config", options->config,
                  "The board under a config that it has or had: its hash, or the first 8 digits or "
                  "more");
  verb.add_option("--at", options->at,
                  "The board as it was at this moment, such as 2026-12-01T12:00:00Z");
  verb.add_option("--explain", options->explain,
                  "Say why one of two submissions (or teams) stands above the other")
      ->expected(2)
      ->type_name("A B");
  verb.add_flag("--statistics", options->statistics,
                "Show which places the episodes decide: groups, intervals and faults");
  verb.add_flag("--rebuild", options->rebuild,
                "Organiser: rebuild the boards from the episodes' rows, which changes no result");
  AddDaemonOptions(verb, "leaderboard", *options);
  return [options] { return Leaderboard(*options); };
}

}  // namespace myograde::server
