// The details of episodes: read by themselves, as no result needs them.
#include <utility>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>

#include "server/store/reader.h"
#include "server/store/stored_row.h"

namespace myograde::server {

absl::StatusOr<std::map<int64_t, std::string>> Reader::EpisodeDetails(int64_t evaluation) {
  SQLite::Statement select(db_, "SELECT idx, details_json FROM episode WHERE evaluation = ? AND "
                                "details_json IS NOT NULL ORDER BY idx");
  select.bind(1, evaluation);
  std::map<int64_t, std::string> details;
  while (select.executeStep()) {
    StoredRow row(select, "episode", absl::StrCat(evaluation, "/", Shown(select.getColumn(0))));
    const int64_t index = row.Number(0, 0, INT64_MAX);
    std::string text = row.Object(1);
    if (!row.ok()) return row.status();
    details.emplace_hint(details.end(), index, std::move(text));
  }
  return details;
}

}  // namespace myograde::server
