#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/accepted.h"
#include "server/store/connection.h"
#include "server/store/quota.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

// Makes room for one more key of a caller.
void DropOldKeys(SQLite::Database& db, const std::string& who, int64_t now_ms) {
  SQLite::Statement aged(db, "DELETE FROM request_key WHERE at < ?");
  aged.bind(1, now_ms - absl::ToInt64Milliseconds(kKeyAge));
  aged.exec();
  SQLite::Statement oldest(
      db, "DELETE FROM request_key WHERE who = ?1 AND key IN (SELECT key FROM request_key "
          "WHERE who = ?1 ORDER BY at DESC, key LIMIT -1 OFFSET ?2)");
  SQLite::bind(oldest, who, kKeysOfOne - 1);
  oldest.exec();
}

void KeepKey(SQLite::Database& db, const std::string& who, const RequestKey& key,
             const Accepted& accepted, int64_t now_ms) {
  SQLite::Statement insert(db, "INSERT INTO request_key VALUES (?, ?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, who, key.key, key.request, accepted.submission, accepted.evaluation,
               accepted.linked ? 1 : 0, now_ms);
  insert.exec();
}

}  // namespace

absl::StatusOr<std::optional<Accepted>> FindRequestKey(SQLite::Database& db,
                                                       const std::string& who,
                                                       const RequestKey& key) {
  if (key.key.empty()) return std::optional<Accepted>();
  SQLite::Statement select(db, "SELECT request, submission, evaluation, linked FROM request_key "
                               "WHERE who = ? AND key = ?");
  SQLite::bind(select, who, key.key);
  if (!select.executeStep()) return std::optional<Accepted>();
  StoredRow row(select, "request_key", absl::StrCat(who, "/", key.key));
  const std::string request = row.Hash(0);
  const Accepted earlier{.submission = row.Number(1, 1, INT64_MAX),
                         .evaluation = row.Number(2, 1, INT64_MAX),
                         .linked = row.Flag(3),
                         .repeated = true};
  if (!row.ok()) return row.status();
  if (request == key.request) return std::optional(earlier);
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat(
          "the Idempotency-Key \"", key.key, "\" came with another request before, for submission ",
          earlier.submission, "; use a new key for each request")),
      kKeyReusedCode);
}

absl::StatusOr<std::optional<Accepted>> Reader::FindRequest(const std::string& who,
                                                            const RequestKey& key) {
  return FindRequestKey(db_, who, key);
}

absl::StatusOr<Accepted> Writer::Once(const std::string& who, const RequestKey& key,
                                      const std::function<absl::StatusOr<Accepted>()>& accept) {
  ASSIGN_OR_RETURN(std::optional<Accepted> earlier, FindRequestKey(db_, who, key));
  if (earlier.has_value()) return *earlier;
  absl::StatusOr<Accepted> accepted = accept();
  if (accepted.ok() && !key.key.empty()) {
    DropOldKeys(db_, who, now_ms_);
    KeepKey(db_, who, key, *accepted, now_ms_);
  }
  return accepted;
}

}  // namespace myograde::server
