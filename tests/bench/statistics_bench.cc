// Time of a board's groups (scoring/groups.h), whose tests are nearly all of what a board's
// statistics cost: one JSON object on standard output.
//
//   statistics_bench [--quick]
//
// A board of 500 teams with 100 episodes each, whose first places lie inside a band, so that all are
// compared by an effort that differs in every episode: no test has a closed form.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "scoring/groups.h"
#include "scoring/track.h"

namespace myograde::scoring {
namespace {

constexpr int64_t kTeams = 500;
constexpr int64_t kEpisodes = 100;
constexpr Metric kBenchMetrics[] = {
    {.name = "time_s", .title = "time", .unit = "s", .better = Better::kLess, .ranked = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .ranked = true}};

[[noreturn]] void FailBench(const std::string& sentence) {
  std::fprintf(stderr, "error: %s\n", sentence.c_str());
  std::exit(2);
}

// Numbers that look random and are the same each time.
double Unit(uint64_t a, uint64_t b) {
  uint64_t mixed = (a * 1'000'003 + b + 1) * 0x9e3779b97f4a7c15;
  mixed = (mixed ^ (mixed >> 31)) * 0xbf58476d1ce4e5b9;
  return static_cast<double>(mixed >> 11) / 9007199254740992.0;
}

std::vector<TestedRow> BenchBoard() {
  std::vector<BoardEntry> entries;
  std::vector<std::vector<JudgedEpisode>> played;
  for (int64_t team = 0; team < kTeams; ++team) {
    std::vector<JudgedEpisode> episodes;
    for (int64_t i = 0; i < kEpisodes; ++i) {
      Verdict verdict{.outcome = Outcome::kSuccess, .steps = 100, .metrics = {}};
      verdict.metrics = {5.0, 1 + 0.001 * static_cast<double>(team) + Unit(team, i)};
      episodes.push_back({i, verdict});
    }
    const auto aggregate = AggregateEpisodes(kBenchMetrics, episodes);
    if (!aggregate.ok()) FailBench(std::string(aggregate.status().message()));
    BoardEntry entry = MakeEntry(kBenchMetrics, *aggregate);
    entry.acceptance = team;
    entry.submission = entry.team = absl::StrCat(team);
    entries.push_back(entry);
    played.push_back(std::move(episodes));
  }
  const auto board = Rank(entries, TieredBoard{}, TeamRule::kBest);
  if (!board.ok()) FailBench(std::string(board.status().message()));
  std::vector<TestedRow> rows;
  for (const RankedEntry& ranked : *board) {
    rows.push_back({ranked, played[static_cast<size_t>(ranked.entry.acceptance)]});
  }
  return rows;
}

nlohmann::json MeasurePlaces(const std::vector<TestedRow>& rows, int64_t places, int64_t samples) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  const Groups groups = FormGroups(kBenchMetrics, rows, TieredBoard{},
                                   {.level = 0.05, .samples = samples, .places = places});
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return {{"teams", kTeams}, {"places", places}, {"samples", samples}, {"tests", groups.tests},
          {"seconds", seconds}};
}

int Main(int argc, char** argv) {
  const bool quick = argc == 2 && std::string(argv[1]) == "--quick";
  if (argc > 1 && !quick) FailBench("usage: statistics_bench [--quick]");
  const std::vector<TestedRow> rows = BenchBoard();
  nlohmann::json by_places = nlohmann::json::array();
  for (const int64_t places : {5, 10, 20, 50}) {
    const int64_t samples = quick ? 100 : std::max<int64_t>(10'000, FewestSamples(0.05, places));
    by_places.push_back(MeasurePlaces(rows, places, samples));
  }
  std::printf("%s\n", nlohmann::json{{"by_places", by_places}}.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace myograde::scoring

int main(int argc, char** argv) { return myograde::scoring::Main(argc, argv); }
