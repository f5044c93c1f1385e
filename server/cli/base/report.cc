#include "server/cli/base/verbs.h"

#include <algorithm>
#include <iostream>
#include <map>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>

#include "server/base/counted.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxFaultsShown = 5;  // of different kinds

void PrintPair(const std::string& name, const std::string& value) {
  // As wide as the longest name and two spaces.
  std::cout << absl::StrFormat("  %-19s ", name) << value << '\n';
}

// "3 done, 1 dropped" of an object at `key`, on a line called `name` unless it is empty.
void PrintCounts(const char* name, const Json& result, const char* key) {
  std::vector<std::string> counts;
  const Json object = result.value(key, Json::object());
  for (const auto& [of, count] : object.items()) {
    counts.push_back(absl::StrCat(count.dump(), " ", Sanitized(of)));
  }
  if (!counts.empty()) PrintPair(name, absl::StrJoin(counts, ", "));
}

void PrintOutput(const Json& outputs) {
  for (const Json& output : outputs) {
    for (const char* stream : {"stderr_tail", "stdout_tail"}) {
      const std::string text = output.value(stream, "");
      if (text.empty()) continue;
      std::cout << Bold(absl::StrCat("The policy's last output on ",
                                     stream[3] == 'e' ? "standard error" : "standard output",
                                     Filled(output, " (episodes {first} to {last})")))
                << '\n'
                << Marked(text);
      return;  // one block is enough to see what went wrong; --json has them all
    }
  }
}

// Under rules that count phantoms, trials that end at once because the one before was solved: the
// rate without them.
void PrintPlayed(const Json& aggregate, const Json& reasons) {
  const int64_t phantoms = reasons.is_object() ? reasons.value("phantom", int64_t{0}) : 0;
  const int64_t played = aggregate.value("episodes", int64_t{0}) - phantoms;
  if (phantoms <= 0 || played <= 0) return;
  const auto successes = aggregate.value("successes", int64_t{0});
  PrintPair("without phantoms",
            absl::StrFormat("%d of %s played, %.1f %%", successes, Counted(played, "episode"),
                            100 * static_cast<double>(successes) / static_cast<double>(played)));
}

// "3", or "0, 1, 2 and 7 more".
std::string EnumeratedEpisodes(const std::vector<std::string>& numbers) {
  constexpr size_t kMost = 8;
  const size_t shown = std::min(numbers.size(), kMost);
  std::string text =
      absl::StrJoin(numbers.begin(), numbers.begin() + static_cast<long>(shown), ", ");
  if (numbers.size() > shown) absl::StrAppend(&text, " and ", numbers.size() - shown, " more");
  return text;
}

}  // namespace

void PrintFaults(const Json& rows) {
  // Episodes that ended the same way stand together, in the order of the first of each.
  std::vector<std::string> details;
  std::map<std::string, std::vector<std::string>> episodes;
  for (const Json& row : rows) {
    if (!row.value("fault", Json()).is_object()) continue;
    const std::string detail = Cell(row["fault"], "detail");
    if (episodes[detail].empty()) details.push_back(detail);
    episodes[detail].push_back(Cell(row, "index"));
  }
  const size_t shown = std::min(details.size(), kMaxFaultsShown);
  for (size_t i = 0; i < shown; ++i) {
    const std::vector<std::string>& same = episodes[details[i]];
    std::cout << (same.size() == 1 ? "episode " : "episodes ") << EnumeratedEpisodes(same) << ": "
              << details[i] << '\n';
  }
  if (details.size() > shown) {
    std::cout << "and " << Counted(static_cast<int64_t>(details.size() - shown), "more fault")
              << " of other kinds; --json lists them all\n";
  }
}

std::string CountsText(const Json& submission) {
  const Json episodes = submission.value("episodes", Json::object());
  std::string text = Filled(episodes, "{done}/{total:episode}");
  // Null: the phase withholds it.
  const Json successes = episodes.value("success", Json(0));
  if (successes.is_null()) return text;
  absl::StrAppend(&text, ", ", Counted(successes.get<int64_t>(), "success", "successes"));
  if (const auto faults = episodes.value("fault", int64_t{0}); faults > 0) {
    absl::StrAppend(&text, ", ", Counted(faults, "fault"), " of the policy");
  }
  return text;
}

void PrintResult(const Json& result, bool full_hashes) {
  const Json aggregate = result.value("aggregate", Json());
  const std::string withheld = Cell(result, "withheld");
  if (!aggregate.is_object()) {
    std::cout << (withheld == "-" ? "  no episode has a result yet\n" :
                  "  no results to show yet\n");
  } else {
    PrintPair("successes", Filled(aggregate, "{successes} of {episodes:episode}"));
    PrintPlayed(aggregate, result.value("reasons", Json()));
    for (const Json& metric : result.value("metrics", Json::array())) {
      const std::string name = metric.value("name", "");
      if (aggregate.value(name, Json()).is_null()) continue;
      PrintPair(Sanitized(metric.value("title", "")),
                Cell(aggregate, name, metric.value("digits", 4)) + Filled(metric, "[ {unit}]"));
    }
  }
  PrintCounts("outcomes", result, "outcomes");
  PrintCounts("failures by reason", result, "reasons");
  const Json hashes = result.value("hashes", Json::object());
  for (const auto& [name, unused] : hashes.items()) {
    PrintPair(name + " hash", HashText(Cell(hashes, name), full_hashes));
  }
  PrintPair("Merkle root", HashText(Cell(result, "merkle_root"), full_hashes));
  PrintOutput(result.value("output", Json::array()));
  if (withheld != "-") {
    std::cout << "  The phase withholds from its participants: " << withheld << ".\n";
  }
  std::cout.flush();
}

std::vector<RowColumn> MetricColumns(const Json& metrics) {
  std::vector<RowColumn> columns;
  for (const Json& metric : metrics) {
    columns.emplace_back(Filled(metric, "{title}[ {unit}]"), metric.value("name", ""),
                         metric.value("digits", 4));
  }
  return columns;
}

void PrintEpisodes(const Json& rows, const Json& metrics, bool full_hashes) {
  Json ranked = Json::array();  // the others are only told of the whole evaluation
  for (const Json& metric : metrics) {
    if (metric.value("better", "") != "neither") ranked.push_back(metric);
  }
  // Of a success, which has no reason of its own, how it ended.
  const auto reason = [](const Json& row) {
    return Cell(row, row.value("outcome", Json()) == "success" ? "end" : "reason");
  };
  std::vector<RowColumn> columns = {"episode=index", "seed", "outcome",
                                    RowColumn("reason", reason), "steps"};
  for (const RowColumn& metric : MetricColumns(ranked)) {
    columns.push_back(ColumnOfPart("metrics", metric));
  }
  columns.push_back(
      {"digest", [&](const Json& row) { return HashText(Cell(row, "digest"), full_hashes); }});
  PrintRows(rows, columns);
  PrintFaults(rows);
}

void PrintUnreadable(const Json& answer) {
  for (const Json& entry : answer.value("unreadable", Json::array())) {
    std::cout << Filled(entry, "  Left out: [evaluation {evaluation}: ]{message}\n");
  }
  std::cout.flush();
}

void PrintList(const Json& answer, const std::string& key, const std::string& none,
               const std::vector<RowColumn>& columns) {
  const Json rows = answer.value(key, Json::array());
  if (rows.empty()) {
    std::cout << none << std::endl;
  } else {
    PrintRows(rows, columns);
  }
}

void PrintChecks(const Json& checks, std::initializer_list<const char*> states, const char* before,
                 const char* advice) {
  PrintRows(checks, {"check=name", "state", "found"});
  for (const char* state : states) {
    for (const Json& check : checks) {
      if (check["state"] != state || check["todo"] == "") continue;
      std::cout << before << Bold(Filled(check, "{name}: {state}")) << Filled(check, advice);
    }
  }
}

}  // namespace myograde::server
