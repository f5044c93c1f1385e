#include "server/cli/client/leaderboard_statistics.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"
#include "server/cli/base/report.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int kMostDigits = 9;

int DigitsOf(const Json& criterion) {
  return static_cast<int>(std::clamp(criterion.value("digits", int64_t{4}), int64_t{0},
                                     int64_t{kMostDigits}));
}

// "0.310 [0.228, 0.406]".
std::string IntervalCell(const Json& row, const Json& criterion) {
  const Json interval =
      row.value("intervals", Json::object()).value(criterion.value("name", ""), Json());
  if (!interval.is_object()) return "-";
  const int digits = DigitsOf(criterion);
  return absl::StrCat(Cell(interval, "value", digits), " [", Cell(interval, "low", digits), ", ",
                      Cell(interval, "high", digits), "]");
}

// The p-value of a test, as corrected: that is what is compared with the level.
std::string TestCell(const Json& row, const char* key) {
  const Json test = row.value(key, Json());
  if (!test.is_object()) return "-";
  const double p = test.value("p_adjusted", 1.0);
  char text[32];
  std::snprintf(text, sizeof(text), p < 1e-4 ? "%.1e" : "%.4f", p);
  return absl::StrCat(text, test.value("decided", false) ? " *" : "",
                      test.value("reversed", false) ? " reversed" : "");
}

void PrintRows(const Json& answer) {
  const Json criteria = answer.value("criteria", Json::array());
  const Json rows = answer.value("rows", Json::array());
  const bool further = std::any_of(rows.begin(), rows.end(), [](const Json& row) {
    return row.value("further_episodes", int64_t{0}) > 0;
  });
  std::vector<std::string> head = {"rank", "group", "team", "policy", "id"};
  for (const Json& criterion : criteria) head.push_back(Cell(criterion, "title"));
  head.insert(head.end(), {"faults", "p (above)", "p (group)"});
  if (further) head.push_back("further");
  Table table(std::move(head));
  for (const Json& row : rows) {
    std::vector<std::string> cells = {row.value("baseline", false) ? "base" : Cell(row, "rank"),
                                      Cell(row, "group"), Cell(row, "team"), Cell(row, "name"),
                                      Cell(row, "submission")};
    for (const Json& criterion : criteria) cells.push_back(IntervalCell(row, criterion));
    cells.push_back(Cell(row, "participant_faults"));
    cells.push_back(TestCell(row, "above"));
    cells.push_back(TestCell(row, "opener"));
    if (further) cells.push_back(Cell(row, "further_episodes"));
    table.Add(std::move(cells));
  }
  table.Print();
}

void PrintMeaning(const Json& answer) {
  const Json used = answer.value("statistics", Json::object());
  std::cout << "  Intervals are 95 %. p: paired permutation test over the same episodes, corrected "
               "(Holm) for "
            << Counted(used.value("tests", int64_t{0}), "test") << " of the first "
            << Cell(used, "places") << " places; * decides at the level "
            << absl::StrCat(used.value("level", 0.0)) << ".\n";
  if (used.value("spending", Json()) == "halving") {
    std::cout << "  Further episodes are another look: the first look at a pair may use half of the level, "
                 "each further one half of what is left.\n";
  }
  const auto undecided = answer.value("undecided", int64_t{0});
  if (undecided > 0) {
    std::cout << "  " << Counted(undecided, "place")
              << " share a group: these episodes do not decide their order.\n";
  }
  if (used.value("ranks", "") == "groups") {
    std::cout << "  Ranks are those of the groups.\n";
  }
}

}  // namespace

void PrintStatistics(const Json& answer) {
  const std::string phase =
      answer.value("phase", Json()).is_string() ? ", phase " + Cell(answer, "phase") : "";
  std::cout << Bold(absl::StrCat("Statistics of ", Cell(answer, "track"), ", profile ",
                                 Cell(answer, "profile"), phase, ", board ",
                                 Cell(answer, "board"), ", ",
                                 CountCell(answer, "episodes", "episode")))
            << '\n';
  if (answer.value("rows", Json::array()).empty()) {
    std::cout << "  The board is empty: only whole evaluations rank.\n";
  } else {
    PrintRows(answer);
    PrintMeaning(answer);
  }
  if (!answer.value("complete", true)) {
    std::cout << "  The board is frozen as of " << Cell(answer, "frozen_at")
              << ": what ended later does not count yet.\n";
  }
  PrintUnreadable(answer);
  std::cout.flush();
}

}  // namespace myograde::server
