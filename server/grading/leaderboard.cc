#include "server/grading/leaderboard.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/json_value.h"

namespace myograde::server {
namespace {

using scoring::BoardEntry;
using scoring::BoardRules;
using scoring::RankedEntry;
using scoring::TeamRule;
using Json = nlohmann::json;

constexpr size_t kBuildDigits = 12;

BoardEntry EntryOf(const StandingRow& row, const scoring::ScoredTrack& track) {
  BoardEntry entry;
  entry.submission = absl::StrCat(row.submission);
  entry.team = row.team;
  entry.acceptance = row.submission;
  entry.chosen = row.chosen;
  const auto count = [&](const char* key) {
    const Json& value = At(row.aggregate, key);
    return value.is_number_integer() ? value.get<int64_t>() : 0;
  };
  entry.successes = count("successes");
  entry.episodes = count("episodes");
  for (const scoring::Metric& metric : track.metrics) {
    if (!metric.ranked) continue;
    const Json& number = At(row.aggregate, metric.name);
    entry.numbers.push_back(number.is_number() ? std::optional(number.get<double>())
                                               : std::nullopt);
  }
  return entry;
}

// Where a baseline stands: the number of ranked rows above it.
absl::StatusOr<std::optional<size_t>> PlaceOf(const BoardEntry& baseline,
                                              const std::vector<RankedEntry>& ranked,
                                              const BoardRules& rules, TeamRule team) {
  std::vector<BoardEntry> entries = {baseline};
  for (const RankedEntry& entry : ranked) entries.push_back(entry.entry);
  ASSIGN_OR_RETURN(std::vector<RankedEntry> with, scoring::Rank(entries, rules, team));
  for (size_t i = 0; i < with.size(); ++i) {
    if (with[i].entry.acceptance == baseline.acceptance) return std::optional(i);
  }
  return std::optional<size_t>();  // below the qualifying line of a board that shows only those
                                   // above it
}

}  // namespace

absl::StatusOr<Leaderboard> MakeLeaderboard(const std::vector<StandingRow>& standings,
                                            const Marks& marks, const BoardRules& rules,
                                            const scoring::TrackScoring& scoring) {
  Leaderboard board;
  std::map<int64_t, const StandingRow*> sources;
  std::vector<BoardEntry> entries;
  std::vector<BoardEntry> baselines;  // each as a team of its own
  for (const StandingRow& row : standings) {
    if (marks.contains({row.submission, kHidden})) continue;
    if (const auto mark = marks.find({row.submission, kDisqualified}); mark != marks.end()) {
      board.disqualified.push_back({row, mark->second});
      continue;
    }
    sources[row.submission] = &row;
    const bool baseline = marks.contains({row.submission, kBaseline});
    BoardEntry& entry =
        (baseline ? baselines : entries).emplace_back(EntryOf(row, *scoring.track));
    if (!baseline) continue;
    // Team names have no control characters, so this is unique.
    entry.team = absl::StrCat("\x01", row.submission);
    entry.chosen = true;
  }
  ASSIGN_OR_RETURN(const std::vector<RankedEntry> ranked,
                   scoring::Rank(entries, rules, scoring.team));
  // By the number of ranked rows above. A ranked row stands below the baselines with as many, which
  // are in the order of their acceptance.
  std::map<std::pair<size_t, int64_t>, RankedEntry> rows;
  for (size_t i = 0; i < ranked.size(); ++i) rows[{i, INT64_MAX}] = ranked[i];
  for (const BoardEntry& baseline : baselines) {
    ASSIGN_OR_RETURN(std::optional<size_t> place, PlaceOf(baseline, ranked, rules, scoring.team));
    if (place.has_value()) rows[{*place, baseline.acceptance}].entry = baseline;
  }
  for (const auto& [place, row] : rows) {
    board.rows.push_back(
        {row, *sources.at(row.entry.acceptance), scoring::IsQualified(row.entry, rules)});
  }
  return board;
}

Json RowToJson(const LeaderboardRow& row) {
  return {{"rank", IdOrNull(row.ranked.rank)},
          {"rank_by_rules", IdOrNull(row.ranked.rank)},
          {"baseline", row.ranked.rank == 0},
          {"team", row.source.team},
          {"submission", row.source.submission},
          {"evaluation", row.source.evaluation},
          {"rejudge", IdOrNull(row.source.rejudge)},
          {"name", row.source.artefact_name},
          {"qualified", row.qualified},
          {"aggregate", row.source.aggregate}};
}

Json BoardToJson(const Leaderboard& board) {
  Json rows = Json::array();
  for (const LeaderboardRow& row : board.rows) rows.push_back(RowToJson(row));
  Json disqualified = Json::array();
  for (const DisqualifiedRow& row : board.disqualified) {
    disqualified.push_back({{"team", row.source.team},
                            {"submission", row.source.submission},
                            {"evaluation", row.source.evaluation},
                            {"rejudge", IdOrNull(row.source.rejudge)},
                            {"name", row.source.artefact_name},
                            {"reason", row.mark.why},
                            {"at", TimeText(row.mark.at)},
                            {"aggregate", row.source.aggregate}});
  }
  return {{"rows", std::move(rows)}, {"disqualified", std::move(disqualified)}};
}

bool HasRankedNumbers(const scoring::ScoredTrack& track, const Json& aggregate) {
  return std::ranges::all_of(track.metrics, [&](const scoring::Metric& metric) {
    return !metric.ranked || aggregate.contains(metric.name);
  });
}

namespace {

std::string WhyAbsent(int64_t id, const std::vector<StandingRow>& standings, const Marks& marks,
                      const Leaderboard& board, TeamRule team) {
  const auto row = std::find_if(standings.begin(), standings.end(),
                                [&](const StandingRow& s) { return s.submission == id; });
  if (row == standings.end()) {
    return "it has no finished ranked evaluation under the present config of this track";
  }
  if (marks.contains({id, kHidden})) return "it is hidden";
  if (marks.contains({id, kDisqualified})) return "it is disqualified";
  if (team == TeamRule::kChosen && !row->chosen) return "its team has not chosen it";
  for (const LeaderboardRow& other : board.rows) {
    if (other.source.team == row->team && other.ranked.rank != 0) {
      return absl::StrCat("its team's entry is submission ", other.source.submission);
    }
  }
  return "it does not reach what this board asks for";
}

absl::StatusOr<const LeaderboardRow*> FindRow(const Leaderboard& board, const std::string& name,
                                              const std::vector<StandingRow>& standings,
                                              const Marks& marks, TeamRule team) {
  int64_t id = 0;
  const bool is_number = absl::SimpleAtoi(name, &id);
  for (const LeaderboardRow& row : board.rows) {
    if (is_number && row.source.submission == id) return &row;
  }
  for (const bool ranked : {true, false}) {  // a baseline's team may have a ranked row as well
    for (const LeaderboardRow& row : board.rows) {
      if (row.source.team == name && (row.ranked.rank != 0) == ranked) return &row;
    }
  }
  if (is_number) {
    return absl::NotFoundError(absl::StrCat("submission ", id, " is not on this board: ",
                                            WhyAbsent(id, standings, marks, board, team)));
  }
  return absl::NotFoundError(absl::StrCat("no team \"", name, "\" is on this board"));
}

}  // namespace

absl::StatusOr<Explanation> ExplainOrder(const std::vector<StandingRow>& standings,
                                         const Marks& marks, const BoardRules& rules,
                                         const scoring::TrackScoring& scoring,
                                         const std::string& a, const std::string& b) {
  const TeamRule team = scoring.team;
  ASSIGN_OR_RETURN(Leaderboard board, MakeLeaderboard(standings, marks, rules, scoring));
  ASSIGN_OR_RETURN(const LeaderboardRow* first, FindRow(board, a, standings, marks, team));
  ASSIGN_OR_RETURN(const LeaderboardRow* second, FindRow(board, b, standings, marks, team));
  if (first == second) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", a, "\" and \"", b, "\" are the same row; name two"));
  }
  // The bands that decide are those of a ranking with both in it.
  std::vector<BoardEntry> entries;
  for (const LeaderboardRow& row : board.rows) {
    if (row.ranked.rank != 0 || &row == first || &row == second) {
      entries.push_back(row.ranked.entry);
    }
  }
  ASSIGN_OR_RETURN(std::vector<RankedEntry> ranked, scoring::Rank(entries, rules, team));
  const auto place = [&](const LeaderboardRow& row) {
    return std::find_if(ranked.begin(), ranked.end(), [&](const RankedEntry& entry) {
      return entry.entry.acceptance == row.ranked.entry.acceptance;
    });
  };
  const bool in_order = place(*first) < place(*second);
  const LeaderboardRow& above = in_order ? *first : *second;
  const LeaderboardRow& below = in_order ? *second : *first;
  RankedEntry upper = *place(above);
  RankedEntry lower = *place(below);
  // Of the board, where a baseline has no rank and its own name.
  upper.rank = above.ranked.rank;
  lower.rank = below.ranked.rank;
  upper.entry.team = above.source.team;
  lower.entry.team = below.source.team;
  return Explanation{above, below, scoring::Explain(upper, lower, rules, scoring.track->metrics)};
}

std::string SimulatingBuild(std::string_view grader_json) {
  const Json grader = Json::parse(grader_json, nullptr, false);
  if (!grader.is_object()) return "";
  Json parts = Json::object();
  for (const char* part : {"simulator", "mujoco", "models"}) {
    parts[part] = grader.value(part, Json());
  }
  return Sha256Hex(CanonicalJson(parts)).substr(0, kBuildDigits);
}

BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders) {
  BoardBuilds builds;
  std::map<std::string, std::string> known;  // boards have many rows of few builds
  std::map<std::string, std::pair<size_t, int64_t>> found;
  for (size_t i = 0; i < graders.size(); ++i) {
    auto it = known.find(graders[i]);
    if (it == known.end()) it = known.emplace(graders[i], SimulatingBuild(graders[i])).first;
    auto& [rows, newest] = found[it->second];
    ++rows;
    newest = std::max(newest, evaluations[i]);
    builds.of_rows.push_back(it->second);
  }
  for (const auto& [build, count] : found) builds.counts.push_back({build, count.first});
  std::sort(builds.counts.begin(), builds.counts.end(),
            [&](const auto& a, const auto& b) { return found[a.build] > found[b.build]; });
  return builds;
}

absl::StatusOr<std::vector<int64_t>> EpisodesInOrder(
    const scoring::TrackScoring& scoring, const std::vector<scoring::JudgedEpisode>& episodes) {
  std::vector<scoring::BoardEntry> entries;
  std::set<int64_t> unranked;
  for (const scoring::JudgedEpisode& episode : episodes) {
    if (episode.verdict.reason.name() == kPhantom) continue;
    ASSIGN_OR_RETURN(const auto aggregate,
                     scoring::AggregateEpisodes(scoring.track->metrics, {episode}));
    scoring::BoardEntry entry = scoring::MakeEntry(scoring.track->metrics, aggregate);
    entry.submission = entry.team = absl::StrCat(episode.index);  // each stands for itself
    entry.acceptance = episode.index;
    if (!unranked.insert(episode.index).second) {
      return absl::InvalidArgumentError(absl::StrCat("two rows are of episode ", episode.index));
    }
    entries.push_back(std::move(entry));
  }
  const auto board = scoring.boards.find(scoring::kMainBoard);
  ASSIGN_OR_RETURN(const auto ranked,
                   scoring::Rank(entries, board->second.rules, scoring::TeamRule::kBest));
  std::vector<int64_t> order;
  for (const scoring::RankedEntry& entry : ranked) {
    order.push_back(entry.entry.acceptance);
    unranked.erase(entry.entry.acceptance);
  }
  order.insert(order.end(), unranked.begin(), unranked.end());
  return order;
}

std::vector<PickedEpisode> BestMedianWorst(const std::vector<int64_t>& order) {
  if (order.empty()) return {};
  if (order.size() == 1) return {{"only", order.front()}};
  if (order.size() == 2) return {{"best", order.front()}, {"worst", order.back()}};
  return {
      {"best", order.front()}, {"median", order[(order.size() - 1) / 2]}, {"worst", order.back()}};
}

}  // namespace myograde::server
