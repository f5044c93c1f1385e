// The details of episodes: in a table of their own and read by themselves, as no result needs them.
#include <utility>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>
#include <absl/strings/str_cat.h>

#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {

void Writer::AddDetails(const EpisodeRow& row) {
  if (row.details_json.empty()) return;
  SQLite::Statement insert(
      db_, "INSERT INTO episode_details (evaluation, idx, details_json) VALUES (?, ?, ?)");
  SQLite::bind(insert, row.evaluation, row.index, row.details_json);
  insert.exec();
}

void Writer::CopyDetails(int64_t from, int64_t to) {
  SQLite::Statement insert(db_, "INSERT INTO episode_details (evaluation, idx, details_json) "
                                "SELECT ?, idx, details_json FROM episode_details "
                                "WHERE evaluation = ? ORDER BY idx");
  SQLite::bind(insert, to, from);
  insert.exec();
}

absl::StatusOr<std::map<int64_t, std::string>> Reader::EpisodeDetails(int64_t evaluation) {
  SQLite::Statement select(
      db_, "SELECT id, idx, details_json FROM episode_details WHERE evaluation = ? ORDER BY idx");
  select.bind(1, evaluation);
  std::map<int64_t, std::string> details;
  while (select.executeStep()) {
    StoredRow row(select, "episode_details", Shown(select.getColumn(0)));
    const int64_t index = row.Number(1, 0, INT64_MAX);
    std::string text = row.Object(2);
    if (!row.ok()) return row.status();
    details.emplace_hint(details.end(), index, std::move(text));
  }
  return details;
}

}  // namespace myograde::server
