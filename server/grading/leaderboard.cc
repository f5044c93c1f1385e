#include "server/grading/leaderboard.h"

#include <algorithm>
#include <map>
#include <optional>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "scoring/aggregate_json.h"
#include "server/base/json_value.h"

namespace myograde::server {
namespace {

using scoring::BoardEntry;
using scoring::BoardRules;
using scoring::RankedEntry;
using scoring::TeamRule;
using Json = nlohmann::json;

BoardEntry EntryOf(const StandingRow& row, const scoring::ScoredTrack& track) {
  BoardEntry entry = scoring::EntryOfJson(track, row.aggregate);
  entry.submission = absl::StrCat(row.submission);
  entry.team = row.team;
  entry.acceptance = row.submission;
  entry.chosen = row.chosen;
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

Json SourceToJson(const StandingRow& row) {
  return {{"team", row.team},
          {"submission", row.submission},
          {"evaluation", row.evaluation},
          {"rejudge", IdOrNull(row.rejudge)},
          {"name", row.artefact_name},
          {"aggregate", row.aggregate}};
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
  Json json = SourceToJson(row.source);
  json["rank"] = json["rank_by_rules"] = IdOrNull(row.ranked.rank);
  json["baseline"] = row.ranked.rank == 0;
  json["qualified"] = row.qualified;
  return json;
}

Json BoardToJson(const Leaderboard& board) {
  Json rows = Json::array();
  for (const LeaderboardRow& row : board.rows) rows.push_back(RowToJson(row));
  Json disqualified = Json::array();
  for (const DisqualifiedRow& row : board.disqualified) {
    disqualified.push_back(SourceToJson(row.source));
    disqualified.back().update({{"reason", row.mark.why}, {"at", TimeText(row.mark.at)}});
  }
  return {{"rows", std::move(rows)}, {"disqualified", std::move(disqualified)}};
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

}  // namespace myograde::server
