#include "server/cli/report.h"

#include <iostream>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/cli/terminal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int kMaxFaultsShown = 5;

void PrintPair(const std::string& name, const std::string& value) {
  std::cout << "  " << name << std::string(name.size() < 18 ? 18 - name.size() : 1, ' ') << value
            << '\n';
}

void PrintMean(const Json& aggregate, const char* key, const char* name, const char* unit,
               int digits) {
  if (!aggregate.contains(key) || aggregate[key].is_null()) return;
  PrintPair(name, Cell(aggregate, key, digits) + unit);
}

std::string CountsOf(const Json& counts) {
  std::string text;
  for (const auto& [name, count] : counts.items()) {
    absl::StrAppend(&text, text.empty() ? "" : ", ", count.dump(), " ", Harmless(name));
  }
  return text;
}

void PrintOutput(const Json& outputs) {
  for (const Json& output : outputs) {
    for (const char* stream : {"stderr_tail", "stdout_tail"}) {
      const std::string text = output.value(stream, "");
      if (text.empty()) continue;
      std::cout << Bold(absl::StrCat("The policy's last words on ",
                                     stream[3] == 'e' ? "standard error" : "standard output",
                                     " (episodes ", Cell(output, "first"), " to ",
                                     Cell(output, "last"), ")"))
                << '\n'
                << Harmless(text, /*lines=*/true) << (text.ends_with('\n') ? "" : "\n");
      return;  // one block is enough to see what went wrong; --json has them all
    }
  }
}

void PrintFaults(const Json& rows) {
  int shown = 0;
  for (const Json& row : rows) {
    if (!row.contains("fault") || !row["fault"].is_object()) continue;
    if (++shown > kMaxFaultsShown) continue;
    std::cout << "episode " << Cell(row, "index") << ": " << Cell(row["fault"], "detail") << '\n';
  }
  if (shown > kMaxFaultsShown) {
    std::cout << "and " << shown - kMaxFaultsShown << " more faults; --json has them all\n";
  }
}

}  // namespace

std::string CountsText(const Json& episodes) {
  std::string text = absl::StrCat(Cell(episodes, "done"), "/", Cell(episodes, "total"),
                                  " episodes, ", Cell(episodes, "success"), " successes");
  if (episodes.value("fault", 0) > 0) {
    absl::StrAppend(&text, ", ", Cell(episodes, "fault"), " faults of the policy");
  }
  return text;
}

void PrintResult(const Json& result) {
  const Json aggregate = result.value("aggregate", Json());
  if (!aggregate.is_object()) {
    std::cout << "  no episode has a result yet\n";
  } else {
    PrintPair("successes", absl::StrCat(Cell(aggregate, "successes"), " of ",
                                        Cell(aggregate, "episodes"), " episodes"));
    PrintMean(aggregate, "distance_m", "distance", " m", 3);
    PrintMean(aggregate, "time_s", "time", " s", 3);
    PrintMean(aggregate, "effort", "effort", "", 5);
    PrintMean(aggregate, "pain", "pain", "", 5);
    PrintMean(aggregate, "peak_force_n", "peak force", " N", 1);
    if (result.value("official_figures", false)) {
      PrintMean(aggregate, "max_touch_n", "peak touch", " N (the official code's peak force)", 1);
    }
  }
  if (result.contains("outcomes")) PrintPair("outcomes", CountsOf(result["outcomes"]));
  if (result.contains("reasons") && !result["reasons"].empty()) {
    PrintPair("failures by reason", CountsOf(result["reasons"]));
  }
  const Json hashes = result.value("hashes", Json::object());
  for (const auto& [name, hash] : hashes.items()) {
    PrintPair(name + " hash", hash.is_string() ? Harmless(hash.get<std::string>()) : "-");
  }
  PrintOutput(result.value("output", Json::array()));
  std::cout.flush();
}

void PrintEpisodes(const Json& rows) {
  const bool locomotion =
      !rows.empty() && !rows[0].value("metrics", Json::object()).value("distance_m", Json()).is_null();
  std::vector<std::string> head = {"episode", "seed", "outcome", "reason", "steps", "time s"};
  if (locomotion) head.push_back("distance m");
  head.insert(head.end(), {"effort", "digest"});
  Table table(std::move(head));
  for (const Json& row : rows) {
    const Json metrics = row.value("metrics", Json::object());
    std::vector<std::string> cells = {Cell(row, "index"),   Cell(row, "seed"),
                                      Cell(row, "outcome"), Cell(row, "reason"),
                                      Cell(row, "steps"),   Cell(metrics, "time_s", 3)};
    if (locomotion) cells.push_back(Cell(metrics, "distance_m", 3));
    cells.push_back(Cell(metrics, "effort", 5));
    cells.push_back(Cell(row, "digest").substr(0, 12));
    table.Add(std::move(cells));
  }
  table.Print();
  PrintFaults(rows);
}

void PrintComparison(const Json& comparison) {
  if (!comparison.is_object()) return;
  for (const Json& episode : comparison.value("episodes", Json::array())) {
    std::cout << "  episode " << Cell(episode, "index") << ": ";
    if (episode.value("equal", false)) {
      std::cout << "equal\n";
      continue;
    }
    std::vector<std::string> differs;
    for (const Json& name : episode.value("differs", Json::array())) {
      if (name.is_string()) differs.push_back(Harmless(name.get<std::string>()));
    }
    const Json before = episode.value("original", Json::object());
    const Json after = episode.value("rerun", Json::object());
    std::cout << "differs in " << absl::StrJoin(differs, ", ") << " (was " << Cell(before, "outcome")
              << " after " << Cell(before, "steps") << " steps, now " << Cell(after, "outcome")
              << " after " << Cell(after, "steps") << ")\n";
  }
  std::cout << "  " << Cell(comparison, "equal") << " of " << Cell(comparison, "compared")
            << " episodes are equal";
  if (comparison.value("missing", 0) > 0) {
    std::cout << "; " << Cell(comparison, "missing") << " can't be compared";
  }
  std::cout << std::endl;
}

void PrintUnreadable(const nlohmann::json& answer) {
  for (const Json& entry : answer.value("unreadable", Json::array())) {
    std::cout << "  Left out: ";
    if (entry.contains("evaluation")) std::cout << "evaluation " << Cell(entry, "evaluation") << ": ";
    std::cout << Cell(entry, "message") << '\n';
  }
  std::cout.flush();
}

}  // namespace myograde::server
