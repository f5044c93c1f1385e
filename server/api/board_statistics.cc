#include "server/api/board_statistics.h"

#include <map>
#include <utility>

#include "server/challenge/challenge.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using scoring::JudgedEpisode;
using scoring::TestedRow;

// Nothing of it counts if a part can't be read.
absl::StatusOr<TestedRow> ReadRow(Reader& reader, const Track& track, const LeaderboardRow& row) {
  const absl::StatusOr<std::vector<EpisodeRow>> rows = reader.Episodes(row.source.evaluation);
  if (!rows.ok()) return rows.status();
  absl::StatusOr<std::vector<JudgedEpisode>> episodes =
      JudgedEpisodes(*track.scoring.track, *rows);
  if (!episodes.ok()) return episodes.status();
  return TestedRow{row.ranked, *std::move(episodes)};
}

std::vector<std::optional<scoring::Spread>> SpreadsOf(const Track& track,
                                                      const scoring::BoardRules& rules,
                                                      const std::vector<JudgedEpisode>& episodes) {
  std::vector<std::optional<scoring::Spread>> spreads;
  for (const scoring::Criterion& criterion : scoring::CriteriaOf(rules)) {
    const bool number = criterion.kind == scoring::Criterion::Kind::kNumber;
    spreads.push_back(number ? scoring::SpreadOverSteps(track.scoring.track->metrics,
                                                        criterion.number, episodes)
                             : std::nullopt);
  }
  return spreads;
}

}  // namespace

scoring::StatisticsConfig StatisticsConfigOf(const ApiContext& context, const std::string& phase) {
  const scoring::StatisticsConfig& usual = context.config.statistics;
  const PhaseConfig* config = context.phases.ConfigOf(phase);
  if (config == nullptr) return usual;
  // Checked when the daemon started.
  return PhaseStatistics(*config, usual).value_or(usual);
}

absl::StatusOr<BoardStatistics> StatisticsOf(Reader& reader, const Track& track,
                                             const scoring::BoardRules& rules,
                                             const Leaderboard& board,
                                             const scoring::GroupRules& group_rules,
                                             int64_t before_ms) {
  BoardStatistics statistics;
  std::vector<TestedRow> tested;
  for (size_t i = 0; i < board.rows.size(); ++i) {
    const LeaderboardRow& row = board.rows[i];
    if (row.ranked.rank == 0) continue;
    if (std::ssize(tested) == group_rules.places) break;
    absl::StatusOr<TestedRow> read = ReadRow(reader, track, row);
    if (const std::optional<Damage> damage = DamageOf(read.status())) {
      statistics.damaged.push_back(*damage);
      continue;
    }
    if (!read.ok()) return read.status();
    statistics.places.push_back({.row = i,
                                 .over_steps = SpreadsOf(track, rules, read->episodes)});
    tested.push_back(*std::move(read));
  }
  scoring::Groups groups =
      scoring::FormGroups(track.scoring.track->metrics, tested, rules, group_rules);
  statistics.tests = groups.tests;
  for (size_t i = 0; i < groups.places.size(); ++i) {
    statistics.places[i].place = std::move(groups.places[i]);
  }
  return statistics;
}

std::vector<int64_t> PublishedRanks(const Leaderboard& board, const BoardStatistics& statistics) {
  std::vector<int64_t> ranks;
  for (const LeaderboardRow& row : board.rows) ranks.push_back(row.ranked.rank);
  std::map<int64_t, int64_t> first;  // rank in each group
  for (const TestedPlace& tested : statistics.places) {
    const int64_t own = board.rows[tested.row].ranked.rank;
    ranks[tested.row] = first.try_emplace(tested.place.group, own).first->second;
  }
  return ranks;
}

}  // namespace myograde::server
