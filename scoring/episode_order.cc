#include "scoring/episode_order.h"

#include <set>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::scoring {

absl::StatusOr<std::vector<int64_t>> EpisodesInOrder(
    const TrackScoring& scoring, const std::vector<JudgedEpisode>& episodes) {
  std::vector<BoardEntry> entries;
  std::set<int64_t> unranked;
  for (const JudgedEpisode& episode : episodes) {
    if (episode.verdict.reason.name() == kPhantom) continue;
    ASSIGN_OR_RETURN(const auto aggregate,
                     AggregateEpisodes(scoring.track->metrics, {episode}));
    BoardEntry entry = MakeEntry(scoring.track->metrics, aggregate);
    entry.submission = entry.team = absl::StrCat(episode.index);  // each stands for itself
    entry.acceptance = episode.index;
    if (!unranked.insert(episode.index).second) {
      return absl::InvalidArgumentError(absl::StrCat("two rows are of episode ", episode.index));
    }
    entries.push_back(std::move(entry));
  }
  const auto board = scoring.boards.find(kMainBoard);
  ASSIGN_OR_RETURN(const auto ranked,
                   Rank(entries, board->second.rules, TeamRule::kBest));
  std::vector<int64_t> order;
  for (const RankedEntry& entry : ranked) {
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

}  // namespace myograde::scoring
