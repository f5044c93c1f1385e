#include "server/api/board_statistics.h"

#include <map>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/api/further_episodes.h"
#include "server/challenge/challenge.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using scoring::JudgedEpisode;
using scoring::TestedRow;

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

// Reads the rows to be tested of one board.
class RowReader {
 public:
  RowReader(Reader& reader, const Track& track, const scoring::BoardRules& rules,
            FurtherItems further, int64_t before_ms)
      : reader_(reader),
        track_(track),
        rules_(rules),
        further_(std::move(further)),
        before_ms_(before_ms) {}

  // Nothing of a row counts if a part can't be read.
  absl::StatusOr<TestedRow> Read(const LeaderboardRow& row, TestedPlace& place) {
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader_.Episodes(row.source.evaluation));
    ASSIGN_OR_RETURN(std::vector<JudgedEpisode> episodes,
                     JudgedEpisodes(*track_.scoring.track, rows));
    const absl::StatusOr<EvaluationRow> evaluation = reader_.Evaluation(row.source.evaluation);
    if (!evaluation.ok()) return evaluation.status();
    RETURN_IF_ERROR(CheckResults(reader_, *evaluation, rows, track_.config.seed_salt));
    place.over_steps = SpreadsOf(track_, rules_, episodes);
    ASSIGN_OR_RETURN(
        Further further,
        FurtherEpisodes(reader_, track_, further_[row.source.submission], before_ms_, indices_));
    place.further = std::ssize(further.episodes);
    episodes.insert(episodes.end(), further.episodes.begin(), further.episodes.end());
    return TestedRow{row.ranked, std::move(episodes), std::move(further.looks)};
  }

 private:
  Reader& reader_;
  const Track& track_;
  const scoring::BoardRules& rules_;
  FurtherItems further_;
  const int64_t before_ms_;
  FurtherIndices indices_;
};

}  // namespace

scoring::StatisticsConfig StatisticsConfigOf(const ApiContext& context, const std::string& phase) {
  const scoring::StatisticsConfig& usual = context.config.statistics;
  const PhaseConfig* config = context.phases.ConfigOf(phase);
  if (config == nullptr) return usual;
  // Checked when the daemon started.
  scoring::StatisticsConfig own = PhaseStatistics(*config, usual).value_or(usual);
  own.groups.further_looks = true;  // only phases have a secret for further seeds
  return own;
}

absl::StatusOr<BoardStatistics> StatisticsOf(Reader& reader, const Track& track,
                                             const scoring::BoardRules& rules,
                                             const Leaderboard& board,
                                             const scoring::GroupRules& group_rules,
                                             int64_t before_ms,
                                             const std::function<bool()>& stopped) {
  ASSIGN_OR_RETURN(FurtherItems further, FurtherItemsOf(reader, track.config.hash));
  RowReader row_reader(reader, track, rules, std::move(further), before_ms);
  BoardStatistics statistics;
  std::vector<TestedRow> tested;
  for (size_t i = 0; i < board.rows.size(); ++i) {
    if (board.rows[i].ranked.rank == 0) continue;
    if (std::ssize(tested) == group_rules.places) break;
    TestedPlace place;
    place.row = i;
    absl::StatusOr<TestedRow> read = row_reader.Read(board.rows[i], place);
    if (const std::optional<Damage> damage = DamageOf(read.status())) {
      statistics.damaged.push_back(*damage);
      continue;
    }
    if (!read.ok()) return read.status();
    tested.push_back(*std::move(read));
    statistics.places.push_back(std::move(place));
  }
  scoring::Groups groups =
      scoring::FormGroups(track.scoring.track->metrics, tested, rules, group_rules, stopped);
  if (groups.stopped) {
    return absl::DeadlineExceededError(
        "the board's statistics take longer than a request may; ask for them again later, or test fewer "
        "places or samples (\"statistics\" in server.json)");
  }
  statistics.tests = groups.tests;
  for (size_t i = 0; i < groups.places.size(); ++i) {
    statistics.places[i].place = groups.places[i];
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
