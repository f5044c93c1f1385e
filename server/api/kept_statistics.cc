#include "server/api/kept_statistics.h"

#include <algorithm>

#include "protocol/base/status_macros.h"
#include "server/api/http_server.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

constexpr int kMostWaitingForStatistics = 2;
constexpr size_t kMostKeptStatistics = 32;
constexpr absl::Duration kLongestWaitForStatistics = absl::Hours(1);  // outside of requests

}  // namespace

KeptStatistics::Made KeptStatistics::Find(const Key& key) {
  const MutexLock lock(mutex_);
  for (const auto& [own, made] : made_) {
    if (own == key) return made;
  }
  return nullptr;
}

absl::StatusOr<std::shared_ptr<const BoardStatistics>> KeptStatistics::Of(
    Reader& reader, const BoardQuery& asked, const Leaderboard& board,
    const scoring::GroupRules& rules) {
  const TrackConfig& track = asked.track->config;
  const BoardMoment moment = asked.moment();
  const Key key = {track.hash, asked.board, moment.freeze_ms,
                   reader.BoardChangedAt(track.hash, track.phase, moment), reader.BoardChanges()};
  if (Made made = Find(key); made != nullptr) return made;
  const absl::Status busy = WithErrorCode(
      absl::UnavailableError("statistics of boards are being computed for others; ask again in some "
                             "seconds"),
      "busy");
  if (++waiting_ > kMostWaitingForStatistics) {
    --waiting_;
    return busy;
  }
  const std::unique_lock<std::timed_mutex> own(
      computing_, absl::ToChronoMilliseconds(
                      std::min(HttpServer::TimeLeft(), kLongestWaitForStatistics)));
  --waiting_;
  if (!own.owns_lock()) return busy;
  if (Made made = Find(key); made != nullptr) return made;
  ASSIGN_OR_RETURN(BoardStatistics computed,
                   StatisticsOf(reader, *asked.track, asked.rules->rules, board, rules,
                                moment.results_before_ms(), HttpServer::IsOver));
  auto made = std::make_shared<const BoardStatistics>(std::move(computed));
  const MutexLock lock(mutex_);
  made_.emplace_front(key, made);
  if (made_.size() > kMostKeptStatistics) made_.pop_back();
  return made;
}

}  // namespace myograde::server
