#include "server/api/board_statistics.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/api/routes.h"
#include "server/challenge/challenge.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"
#include "server/http/http_server.h"

namespace myograde::server {
namespace {

constexpr int kMostWaitingForStatistics = 2;
constexpr absl::Duration kLongestWaitForStatistics = absl::Hours(1);  // outside of requests

using scoring::JudgedEpisode;
using scoring::TestedRow;

std::vector<std::optional<scoring::Spread>> ComputeSpreads(
    const Track& track, const scoring::BoardRules& rules,
    const std::vector<JudgedEpisode>& episodes) {
  std::vector<std::optional<scoring::Spread>> spreads;
  for (const scoring::Criterion& criterion : scoring::ListCriteria(rules)) {
    const bool number = criterion.kind == scoring::Criterion::Kind::kNumber;
    spreads.push_back(
        number ? scoring::SpreadOverSteps(track.scoring.track->metrics, criterion.number, episodes)
               : std::nullopt);
  }
  return spreads;
}

// One index for every seed, after those of all episodes that rank, so that the same further episode
// of two submissions makes a pair.
using FurtherIndices = std::map<uint64_t, int64_t>;

struct Further {
  std::vector<scoring::JudgedEpisode> episodes;  // each seed once
  std::set<int64_t> looks;                       // TestedRow::further
};

// The episodes of items that ended before `before_ms`. A damaged row (store/damage.h) if one can't
// be read.
absl::StatusOr<Further> FurtherEpisodes(const Transaction& reader, const Track& track,
                                        const std::vector<FurtherItem>& items, int64_t before_ms,
                                        FurtherIndices& indices) {
  Further further;
  std::set<uint64_t> seen;  // seeds, of dropped ones too
  std::set<int64_t> there;
  for (const FurtherItem& item : items) {
    if (item.state != EvaluationState::kDone && item.state != EvaluationState::kFailed) continue;
    ASSIGN_OR_RETURN(const EvaluationRow evaluation, reader.evaluations.Find(item.evaluation));
    if (evaluation.finished_at >= before_ms) continue;
    seen.insert(item.seeds.begin(), item.seeds.end());
    further.looks.insert(std::ssize(seen));
    if (item.dropped) continue;
    ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.episodes.Of(item.evaluation));
    for (EpisodeRow& row : rows) {
      const int64_t next = kMaxEpisodes + std::ssize(indices);
      row.index = indices.try_emplace(row.seed, next).first->second;
    }
    ASSIGN_OR_RETURN(const std::vector<scoring::JudgedEpisode> judged,
                     JudgedEpisodes(*track.scoring.track, rows));
    for (const scoring::JudgedEpisode& episode : judged) {
      if (there.insert(episode.index).second) further.episodes.push_back(episode);
    }
  }
  return further;
}

// One row to be tested. `items`: its further episodes. Nothing of a row counts if a part can't be
// read.
absl::StatusOr<TestedRow> ReadRow(const Transaction& reader, const Track& track,
                                  const scoring::BoardRules& rules, const LeaderboardRow& row,
                                  const std::vector<FurtherItem>& items, int64_t before_ms,
                                  FurtherIndices& indices, TestedPlace& place) {
  ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.episodes.Of(row.source.evaluation));
  ASSIGN_OR_RETURN(std::vector<JudgedEpisode> episodes, JudgedEpisodes(*track.scoring.track, rows));
  ASSIGN_OR_RETURN(const EvaluationRow evaluation, reader.evaluations.Find(row.source.evaluation));
  RETURN_IF_ERROR(CheckResults(reader, evaluation, rows, track.config.seed_salt));
  place.over_steps = ComputeSpreads(track, rules, episodes);
  ASSIGN_OR_RETURN(Further further, FurtherEpisodes(reader, track, items, before_ms, indices));
  place.further = std::ssize(further.episodes);
  episodes.insert(episodes.end(), further.episodes.begin(), further.episodes.end());
  return TestedRow{row.ranked, std::move(episodes), std::move(further.looks)};
}

}  // namespace

absl::StatusOr<FurtherItems> ListFurtherItems(const Transaction& reader,
                                              const std::string& config) {
  FurtherItems all;
  for (const auto& [id, rejudge] : reader.Board().rejudges()) {
    if (rejudge.purpose != RejudgePurpose::kSeeds || rejudge.from_config != config) continue;
    const bool dropped = rejudge.last() == RejudgeEvent::kDropped;
    const auto seeds = StoredSeeds(reader, rejudge.seeds);
    const auto items = reader.evaluations.OfRejudge(id);
    if (IsLeftOut(seeds.status()) || IsLeftOut(items.status())) continue;
    RETURN_IF_ERROR(seeds.status());
    RETURN_IF_ERROR(items.status());
    std::set<int64_t> to_come = rejudge.submissions;
    for (const EvaluationRow& item : *items) {
      to_come.erase(item.submission);
      const bool has_none =
          item.state == EvaluationState::kCancelled || item.state == EvaluationState::kGraderError;
      if (!has_none) all[item.submission].push_back({item.id, item.state, *seeds, dropped});
    }
    for (const int64_t submission : to_come) {
      if (!dropped) all[submission].push_back({.seeds = *seeds});
    }
  }
  return all;
}

scoring::StatisticsConfig FindStatisticsConfig(const ApiContext& context,
                                               const std::string& phase) {
  const scoring::StatisticsConfig& fallback = context.config.statistics;
  const PhaseConfig* config = context.phases.ConfigOf(phase);
  if (config == nullptr) return fallback;
  // Checked when the daemon started.
  scoring::StatisticsConfig own = PhaseStatistics(*config, fallback).value_or(fallback);
  own.groups.further_looks = true;  // only phases have a secret for further seeds
  return own;
}

absl::StatusOr<BoardStatistics> ComputeStatistics(const Transaction& reader, const Track& track,
                                                  const scoring::BoardRules& rules,
                                                  const Leaderboard& board,
                                                  const scoring::GroupRules& group_rules,
                                                  int64_t before_ms) {
  ASSIGN_OR_RETURN(FurtherItems further, ListFurtherItems(reader, track.config.hash));
  FurtherIndices indices;
  BoardStatistics statistics;
  std::vector<TestedRow> tested;
  for (size_t i = 0; i < board.rows.size(); ++i) {
    if (board.rows[i].ranked.rank == 0) continue;
    if (std::ssize(tested) == group_rules.places) break;
    TestedPlace place;
    place.row = i;
    absl::StatusOr<TestedRow> read =
        ReadRow(reader, track, rules, board.rows[i], further[board.rows[i].source.submission],
                before_ms, indices, place);
    if (const std::optional<Damage> damage = ExtractDamage(read.status())) {
      statistics.damaged.push_back(*damage);
      continue;
    }
    if (!read.ok()) return read.status();
    tested.push_back(*std::move(read));
    statistics.places.push_back(std::move(place));
  }
  scoring::Groups groups = scoring::FormGroups(track.scoring.track->metrics, tested, rules,
                                               group_rules, HttpServer::IsOver);
  if (groups.stopped) {
    return absl::DeadlineExceededError(
        "the board's statistics take longer than a request may; try again later, or test fewer "
        "places or samples (\"statistics\" of server.json)");
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

KeptStatistics::Made KeptStatistics::Find(const std::string& key) {
  const MutexLock lock(mutex_);
  const Made* made = made_.Find(key);
  return made == nullptr ? nullptr : *made;
}

absl::StatusOr<std::shared_ptr<const BoardStatistics>> KeptStatistics::Of(
    const Transaction& reader, const BoardQuery& asked, const Leaderboard& board,
    const scoring::GroupRules& rules) {
  const TrackConfig& track = asked.track->config;
  const BoardMoment moment = asked.moment();
  const std::string key = absl::StrJoin(
      std::tuple(track.hash, asked.board, moment.freeze_ms,
                 reader.Board().ChangedAt(track.hash, track.phase, moment),
                 reader.BoardChanges()),
      "/");
  if (Made made = Find(key); made != nullptr) return made;
  const absl::Status busy = Busy(
      "other boards' statistics are being computed; try again in a few seconds", 1);
  if (++waiting_ > kMostWaitingForStatistics) {
    --waiting_;
    return busy;
  }
  const std::unique_lock<std::timed_mutex> own(
      computing_,
      absl::ToChronoMilliseconds(std::min(HttpServer::TimeLeft(), kLongestWaitForStatistics)));
  --waiting_;
  if (!own.owns_lock()) return busy;
  if (Made made = Find(key); made != nullptr) return made;
  ASSIGN_OR_RETURN(BoardStatistics computed,
                   ComputeStatistics(reader, *asked.track, asked.rules->rules, board, rules,
                                     moment.results_before_ms()));
  auto made = std::make_shared<const BoardStatistics>(std::move(computed));
  const MutexLock lock(mutex_);
  return made_.FindOr(key, made);
}

}  // namespace myograde::server
