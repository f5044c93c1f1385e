#include "server/cli/client/rejudge_text.h"

#include <iostream>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/base/counted.h"
#include "server/cli/base/report.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kDigits = 12;

std::string HashCell(const Json& object, const char* key) {
  return object.value(key, "").substr(0, kDigits);
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

std::string MoveText(const Json& before, const Json& after) {
  if (before.is_null()) return "new";
  if (after.is_null()) return "gone";
  if (!before.value("rank", Json()).is_number() || !after.value("rank", Json()).is_number()) {
    return "-";
  }
  const int64_t up = before.value("rank", int64_t{0}) - after.value("rank", int64_t{0});
  if (up == 0) return "same";
  return up > 0 ? absl::StrCat("up ", up) : absl::StrCat("down ", -up);
}

// A cell of what `make` says of the row before and after, of which one may be missing.
template <typename Make>
std::string PairText(const Json& before, const Json& after, Make make) {
  if (before.is_null()) return make(after);
  if (after.is_null()) return make(before);
  return BothText(make(before), make(after));
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
  const std::vector<MetricColumn> columns = MetricColumns(board.value("columns", Json::array()));
  std::vector<std::string> head = {"rank", "change", "team", "id", "success"};
  for (const MetricColumn& column : columns) head.push_back(column.title);
  Table table(std::move(head));
  for (const Json& row : rows) {
    const Json before = row.value("before", Json());
    const Json after = row.value("after", Json());
    const auto rank = [](const Json& side) {
      return side.is_null() ? std::string("-")
             : side.value("baseline", false) ? std::string("base") : Cell(side, "rank");
    };
    std::vector<std::string> cells = {
        BothText(rank(before), rank(after)), MoveText(before, after), Cell(row, "team"),
        PairText(before, after, [](const Json& side) { return Cell(side, "submission"); }),
        PairText(before, after, [](const Json& side) {
          return Cell(side.value("aggregate", Json::object()), "successes");
        })};
    for (const MetricColumn& column : columns) {
      cells.push_back(PairText(before, after, [&](const Json& side) {
        return Cell(side.value("aggregate", Json::object()), column.key, column.digits);
      }));
    }
    table.Add(std::move(cells));
  }
  table.Print();
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
              << Cell(item, "team") << " differs in " << (indices.size() == 1 ? "episode " : "episodes ")
              << absl::StrJoin(indices, ", ") << ".\n";
  }
}

void PrintWithoutResult(const Json& rejudge) {
  for (const Json& item : rejudge.value("without_result", Json::array())) {
    std::cout << "Without a result: submission " << Cell(item, "submission") << " of "
              << Cell(item, "team") << " is " << Cell(item, "state") << ": "
              << Cell(item, "reason") << '\n';
  }
}

void PrintEvents(const Json& rejudge) {
  for (const Json& event : rejudge.value("events", Json::array())) {
    std::cout << Cell(event, "event") << " at " << Cell(event, "at") << " by "
              << Cell(event, "who") << ": " << Cell(event, "reason") << '\n';
  }
}

// What can be done next.
void PrintNext(const Json& rejudge) {
  const std::string state = Cell(rejudge, "state");
  const std::string id = Cell(rejudge, "rejudge");
  if (state == "computing") {
    std::cout << "It is being computed; the live board stays as it is.\n";
  } else if (state == "ready" && Cell(rejudge, "purpose") == "rules") {
    std::cout << "The live board is as it was. \"myograde rejudge apply " << id
              << " --reason TEXT\" makes these its results, \"myograde rejudge drop " << id
              << " --reason TEXT\" leaves it.\n";
  }
}

}  // namespace

std::string RejudgedBoard(const Json& rejudge) {
  if (rejudge.value("phase", Json()).is_string()) return "phase " + Cell(rejudge, "phase");
  return absl::StrCat("track ", Cell(rejudge, "track"), ", profile ", Cell(rejudge, "profile"));
}

void PrintRejudges(const Json& answer) {
  const Json rejudges = answer.value("rejudges", Json::array());
  if (rejudges.empty()) {
    std::cout << "Nothing was rejudged yet; \"myograde rejudge create\" begins one." << std::endl;
  } else {
    Table table({"id", "state", "board", "to config", "results", "created", "reason"});
    for (const Json& one : rejudges) {
      table.Add({Cell(one, "rejudge"), Cell(one, "state"), RejudgedBoard(one),
                 HashCell(one, "to_config"), ItemsText(one), Cell(one, "at"),
                 Cell(one, "reason")});
    }
    table.Print();
  }
  PrintUnreadable(answer);
  std::cout.flush();
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
  PrintEvents(rejudge);
  PrintWithoutResult(rejudge);
  PrintNotRepeatable(rejudge);
  for (const Json& board : rejudge.value("boards", Json::array())) PrintChanges(board);
  if (!rejudge.value("unreadable", Json::array()).empty()) PrintUnreadable(rejudge);
  PrintNext(rejudge);
  if (const auto left = rejudge.value("accepted_under_to_config", int64_t{0}); left > 0) {
    std::cout << Counted(left, "submission") << " accepted under the new config "
              << (left == 1 ? "stays" : "stay") << " under it, off the board that is now shown.\n";
  }
  std::cout.flush();
}

}  // namespace myograde::server
