// Episodes by their logs, and evaluations as they end: for those who make pictures of them.
#include <algorithm>

#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/episode_log.h"
#include "server/store/reader.h"
#include "server/store/stored_row.h"

namespace myograde::server {

absl::StatusOr<LoggedEpisode> Reader::EpisodeOfLog(const std::string& sha256) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT evaluation, idx, lease, seed FROM episode WHERE (", kLogOfEpisode,
                        ") = ? ORDER BY evaluation, idx LIMIT 1"));
  select.bind(1, sha256);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("no episode has the log ", sha256));
  }
  StoredRow row(select, "episode",
                absl::StrCat(Shown(select.getColumn(0)), "/", Shown(select.getColumn(1))));
  LoggedEpisode episode;
  episode.evaluation = row.Number(0, 1, INT64_MAX);
  episode.index = row.Number(1, 0, INT64_MAX);
  episode.lease = row.Number(2, 1, INT64_MAX);
  episode.seed = static_cast<uint64_t>(row.Number(3, 0, INT64_MAX));
  if (!row.ok()) return row.status();
  return episode;
}

std::vector<EndedEvaluation> Reader::DoneSince(int64_t after_ms, int64_t limit) {
  SQLite::Statement select(db_, "SELECT id, finished_at FROM evaluation WHERE state = 'done' AND "
                                "finished_at > ? ORDER BY finished_at DESC, id DESC LIMIT ?");
  SQLite::bind(select, after_ms, limit);
  std::vector<EndedEvaluation> ended;
  while (select.executeStep()) {
    ended.push_back({select.getColumn(0).getInt64(), select.getColumn(1).getInt64()});
  }
  std::reverse(ended.begin(), ended.end());
  return ended;
}

int64_t Reader::LastEnd() {
  SQLite::Statement select(db_, "SELECT ifnull(max(finished_at), 0) FROM evaluation");
  select.executeStep();
  return select.getColumn(0).getInt64();
}

}  // namespace myograde::server
