// myograde rejudge: create, list, show, apply, drop
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include <cstdint>
#include <functional>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

std::string HashCell(const Json& object, const char* key) {
  return HashText(object.value(key, ""), /*full=*/false);
}

// "300 of 300 results".
std::string ItemsText(const Json& rejudge) {
  const Json items = rejudge.value("items", Json::object());
  return absl::StrCat(Cell(items, "ended"), " of ", CountCell(items, "total", "result"));
}

// A number before and after: one where they are the same.
std::string BothText(const std::string& before, const std::string& after) {
  return before == after ? before : absl::StrCat(before, " → ", after);
}

std::string SideRank(const Json& side) {
  if (side.is_null()) return "-";
  return side.value("baseline", false) ? "base" : Cell(side, "rank");
}

std::string MoveText(const Json& row) {
  const Json before = row.value("before", Json());
  const Json after = row.value("after", Json());
  if (before.is_null()) return "new";
  if (after.is_null()) return "gone";
  if (!before.value("rank", Json()).is_number() || !after.value("rank", Json()).is_number()) {
    return "-";
  }
  const int64_t up = before.value("rank", int64_t{0}) - after.value("rank", int64_t{0});
  if (up == 0) return "same";
  return up > 0 ? absl::StrCat("up ", up) : absl::StrCat("down ", -up);
}

// What `make` says of a row before and after, of which one may be missing.
RowColumn BothColumn(std::string head, std::function<std::string(const Json& side)> make) {
  return {std::move(head), [make = std::move(make)](const Json& row) {
            const Json before = row.value("before", Json());
            const Json after = row.value("after", Json());
            if (before.is_null()) return make(after);
            return after.is_null() ? make(before) : BothText(make(before), make(after));
          }};
}

RowColumn AggregateColumn(const RowColumn& column) {
  return BothColumn(column.head, ColumnOfPart("aggregate", column).cell);
}

void PrintChanges(const Json& board) {
  std::cout << '\n'
            << Bold(absl::StrCat("Board ", Cell(board, "board"), ": ",
                                 CountCell(board, "moved", "change")))
            << '\n';
  const Json rows = board.value("rows", Json::array());
  if (rows.empty()) {
    std::cout << "  It is empty, before and after.\n";
    return;
  }
  std::vector<RowColumn> columns = {
      RowColumn("rank",
                [](const Json& row) {
                  return BothText(SideRank(row.value("before", Json())),
                                  SideRank(row.value("after", Json())));
                }),
      RowColumn("change", MoveText), "team",
      BothColumn("id", [](const Json& side) { return Cell(side, "submission"); }),
      AggregateColumn("success=successes")};
  for (const RowColumn& metric : MetricColumns(board.value("columns", Json::array()))) {
    columns.push_back(AggregateColumn(metric));
  }
  PrintRows(rows, columns);
  if (const std::string order = Cell(board, "order"); order != "-") {
    std::cout << "  " << order << '\n';
  }
}

void PrintNotRepeatable(const Json& rejudge) {
  for (const Json& item : rejudge.value("not_repeatable", Json::array())) {
    std::vector<std::string> indices;
    for (const Json& episode : item.value("episodes", Json::array())) {
      indices.push_back(Cell(episode, "index"));
    }
    std::cout << "Not repeatable: submission " << Cell(item, "submission") << " of "
              << Cell(item, "team") << " differs in "
              << (indices.size() == 1 ? "episode " : "episodes ") << absl::StrJoin(indices, ", ")
              << ".\n";
  }
}

void PrintWithoutResult(const Json& rejudge) {
  for (const Json& item : rejudge.value("without_result", Json::array())) {
    std::cout << "Without a result: submission " << Cell(item, "submission") << " of "
              << Cell(item, "team") << " is " << Cell(item, "state") << ": " << Cell(item, "reason")
              << '\n';
  }
}

void PrintRejudgeEvents(const Json& rejudge) {
  for (const Json& event : rejudge.value("events", Json::array())) {
    std::cout << Cell(event, "event") << " at " << Cell(event, "at") << " by " << Cell(event, "who")
              << ": " << Cell(event, "reason") << '\n';
  }
}

// What can be done next.
void PrintNext(const Json& rejudge) {
  const std::string state = Cell(rejudge, "state");
  const std::string id = Cell(rejudge, "rejudge");
  if (state == "computing") {
    std::cout << "It is being computed; the live board is unchanged.\n";
  } else if (state == "ready" && Cell(rejudge, "purpose") == "rules") {
    std::cout << "The live board is unchanged. \"myograde board rejudge apply " << id
              << " --reason TEXT\" puts these results on it, \"myograde board rejudge drop " << id
              << " --reason TEXT\" discards them.\n";
  }
}

std::string RejudgedBoard(const Json& rejudge) {
  if (rejudge.value("phase", Json()).is_string()) return "phase " + Cell(rejudge, "phase");
  return absl::StrCat("track ", Cell(rejudge, "track"), ", profile ", Cell(rejudge, "profile"));
}

void PrintRejudge(const Json& rejudge) {
  const Json items = rejudge.value("items", Json::object());
  std::cout << Bold(absl::StrCat("Rejudge ", Cell(rejudge, "rejudge"), " of ",
                                 RejudgedBoard(rejudge), " is ", Cell(rejudge, "state")))
            << '\n'
            << "config   " << HashCell(rejudge, "from_config") << " → "
            << HashCell(rejudge, "to_config") << '\n'
            << "results  " << ItemsText(rejudge) << "; from facts " << Cell(items, "facts")
            << ", played " << Cell(items, "play") << '\n';
  if (rejudge.value("repeats", int64_t{1}) > 1) {
    std::cout << "repeats  " << Cell(rejudge, "repeats") << '\n';
  }
  PrintRejudgeEvents(rejudge);
  PrintWithoutResult(rejudge);
  PrintNotRepeatable(rejudge);
  for (const Json& board : rejudge.value("boards", Json::array())) PrintChanges(board);
  if (!rejudge.value("unreadable", Json::array()).empty()) PrintUnreadable(rejudge);
  PrintNext(rejudge);
  if (const auto left = rejudge.value("accepted_under_to_config", int64_t{0}); left > 0) {
    std::cout << Counted(left, "submission") << " accepted under the new config "
              << (left == 1 ? "stays" : "stay") << " under it, and off the board now shown.\n";
  }
  std::cout.flush();
}

constexpr char kRejudges[] = "/v1/rejudges";
// No config is near that; the daemon takes bodies of the same size.
constexpr size_t kMaxConfigBytes = 1u << 20;

struct RejudgeOptions : DaemonOptions {
  int64_t id = 0;
  std::string phase;
  std::string track;
  std::string profile;
  std::string config;  // file
  std::string method = "auto";
  int64_t repeat = 1;
  std::string reason;
  std::vector<int64_t> without;
  bool wait = false;

  std::string Resource(const std::string& part = "") const {
    return absl::StrCat(kRejudges, "/", id, part);
  }
};

// With every rank's change, or those that can be told so far.
absl::StatusOr<int> ShowRejudge(const RejudgeOptions& options) {
  if (options.wait) {
    RETURN_IF_ERROR(
        FollowUntil(options.client(), options.Resource(), absl::StrCat("rejudge ", options.id),
                    [](const Json& rejudge) { return rejudge.value("state", "") != "computing"; })
            .status());
  }
  ASSIGN_OR_RETURN(const Json rejudge, options.client().Get(options.Resource("?changes=1")));
  RETURN_IF_ERROR(PrintAnswer(rejudge, options.json, PrintRejudge).status());
  const bool whole = rejudge.value("without_result", Json::array()).empty();
  return !options.wait || whole ? kDone : kNoScore;
}

absl::StatusOr<Json> NewRejudge(const RejudgeOptions& options) {
  if (options.phase.empty() == options.track.empty()) {
    return absl::InvalidArgumentError(
        "name the board to rejudge with --phase, or with --track for a track's own");
  }
  if (!options.phase.empty() && !options.profile.empty()) {
    return absl::InvalidArgumentError("--profile: a phase already has one; leave it out");
  }
  Json body = {{"reason", options.reason},
               {"method", options.method},
               {"repeats", options.repeat}};
  for (const auto& [key, value] : {std::pair{"phase", &options.phase},
                                   std::pair{"track", &options.track},
                                   std::pair{"profile", &options.profile}}) {
    if (!value->empty()) body[key] = *value;
  }
  if (options.config.empty()) return body;
  ASSIGN_OR_RETURN(Json config, ReadJsonFile(options.config, kMaxConfigBytes));
  if (!config.is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(
        options.config, ": not a track config, which is a JSON object; see configs/README.md"));
  }
  body["config"] = std::move(config);
  return body;
}

absl::StatusOr<int> CreateRejudge(RejudgeOptions options) {
  ASSIGN_OR_RETURN(const Json body, NewRejudge(options));
  const absl::StatusOr<Json> created = options.client().Post(kRejudges, body);
  if (!created.ok() || !options.wait) return PrintAnswer(created, options.json, PrintRejudge);
  options.id = created->value("rejudge", int64_t{0});
  return ShowRejudge(options);
}

absl::StatusOr<int> ApplyRejudge(const RejudgeOptions& options) {
  Json body = {{"reason", options.reason}};
  if (!options.without.empty()) body["without"] = options.without;
  return options.PostAndPrint(options.Resource("/apply"), body, [](const Json& rejudge) {
    std::cout << "The board of " << RejudgedBoard(rejudge) << " now has the results of rejudge "
              << Cell(rejudge, "rejudge") << ", and its config is "
              << HashCell(rejudge, "to_config") << "." << std::endl;
  });
}

absl::StatusOr<int> DropRejudge(const RejudgeOptions& options) {
  return options.PostAndPrint(options.Resource("/drop"), {{"reason", options.reason}},
                              PrintRejudge);
}

absl::StatusOr<int> ListRejudges(const RejudgeOptions& options) {
  return PrintAnswer(
      GetAllPages(options.client(), kRejudges, "rejudges"), options.json, [](const Json& answer) {
        PrintList(
            answer, "rejudges", "There are no rejudges yet; start one with \"myograde board "
                                "rejudge create\".",
            {"id=rejudge", "state", RowColumn("board", RejudgedBoard),
             RowColumn("to config", [](const Json& one) { return HashCell(one, "to_config"); }),
             RowColumn("results", ItemsText), "created=at", "reason"});
      });
}

// The parts of the verb that are about one rejudge.
class RejudgeParts : public DaemonParts<RejudgeOptions> {
 public:
  using DaemonParts::DaemonParts;

  CLI::App* AddOfOne(const char* name, const char* does, const char* example,
                     std::function<absl::StatusOr<int>(const RejudgeOptions&)> action) {
    CLI::App* part = Add(name, does, example, "rejudge", std::move(action));
    part->add_option("ID", options().id, "The rejudge, as \"myograde board rejudge list\" numbers it")
        ->required()
        ->check(CLI::PositiveNumber);
    return part;
  }
  void AddReason(CLI::App* part) {
    part->add_option("--reason", options().reason, "Why, for the record; up to 200 bytes")
        ->required();
  }
};

void AddCreatePart(RejudgeParts& parts) {
  RejudgeOptions& options = parts.options();
  CLI::App* create = parts.Add(
      "create", "Compute a board's results under another config, without touching the live board",
      "create --phase final --config new_rules.json --reason \"The line is 80.\" --wait", "rejudge",
      CreateRejudge);
  create->add_option("--phase", options.phase, "The phase whose board is rejudged");
  create->add_option("--track", options.track, "The track whose own board is rejudged");
  create->add_option("--profile", options.profile, "Rules profile (default: the track's own)");
  create
      ->add_option("--config", options.config,
                   "A track config, like those of configs/tracks (default: the same config, for "
                   "another build of the grader or for --repeat)")
      ->type_name("FILE");
  create->add_option("--method", options.method,
                     "facts: compute the results from the recorded facts; play: run all episodes "
                     "again; auto: facts where they are enough (default)")
      ->check(CLI::IsMember({"auto", "facts", "play"}));
  create->add_option("--repeat", options.repeat,
                     "Play each episode this many times and report the policies that are not "
                     "repeatable, 1 to 20 (default: 1)")
      ->check(CLI::Range(1, 20));
  create->add_flag("--wait", options.wait,
                   "Wait until it is computed, and show how each rank changes");
  parts.AddReason(create);
}

}  // namespace

Command AddRejudge(CLI::App& verb) {
  RejudgeParts parts(verb);
  AddCreatePart(parts);
  parts.Add("list", "List all rejudges, newest first", "list", "rejudges", ListRejudges);
  parts.AddOfOne("show", "Show a rejudge, and how each rank changes", "show 3", ShowRejudge)
      ->add_flag("--wait", parts.options().wait, "Wait until it is computed");
  CLI::App* apply = parts.AddOfOne(
      "apply", "Put a rejudge's config and results on the live board",
      "apply 3 --reason \"As announced on 3 May.\"", ApplyRejudge);
  apply->add_option("--without", parts.options().without,
                    "All submissions without a result, as in 7,9: they leave the board")
      ->delimiter(',')
      ->type_name("IDS");
  parts.AddReason(apply);
  parts.AddReason(parts.AddOfOne(
      "drop", "Discard a rejudge; if it was applied, restore the board that it replaced",
      "drop 3 --reason \"The jury decided otherwise.\"", DropRejudge));
  return {};
}

}  // namespace myograde::server
