#include "server/store/record.h"

#include <optional>
#include <string>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/store/reader.h"
#include "server/store/record_appender.h"
#include "server/store/record_entries.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kColumns[] = "SELECT id, entry_json, chain FROM record ";

StoredRow RecordRowOf(SQLite::Statement& select, RecordRow& record) {
  StoredRow row(select, "record", Shown(select.getColumn(0)));
  record.index = row.Number(0, 0, kMany);
  record.entry_json = row.Object(1);
  record.chain = row.Hash(2);
  return row;
}

// Whether the latest key of the record is this one.
bool IsLatestKey(SQLite::Database& db, const std::string& public_pem) {
  SQLite::Statement last(db, "SELECT entry_json FROM record WHERE kind = 'key' "
                             "ORDER BY id DESC LIMIT 1");
  if (!last.executeStep()) return false;
  const Json entry = Json::parse(last.getColumn(0).getString(), nullptr, false);
  return entry.is_object() && entry.value("key", Json()) == public_pem;
}

}  // namespace

std::string ChainOf(std::string_view before, std::string_view entry_json) {
  Sha256 hash;
  hash.Update(before);
  hash.Update("\n");
  hash.Update(entry_json);
  return hash.FinishHex();
}

std::string ArtefactCommitment(int64_t submission, const std::string& artefact) {
  return Sha256Hex(absl::StrCat("myograde artefact/", submission, "/", artefact));
}

RecordAppender::RecordAppender(SQLite::Database& db)
    : insert_(db, "INSERT INTO record (id, at, kind, evaluation, entry_json, chain) "
                  "VALUES (?, ?, ?, nullif(?, 0), ?, ?)") {
  SQLite::Statement last(db, absl::StrCat(kColumns, "ORDER BY id DESC LIMIT 1"));
  if (!last.executeStep()) return;
  next_ = last.getColumn(0).getInt64() + 1;
  chain_ = last.getColumn(2).getString();
}

void RecordAppender::Append(const std::string& kind, const RecordEntry& entry) {
  const std::string text = CanonicalJson(entry.content);
  chain_ = ChainOf(chain_, text);
  insert_.reset();
  SQLite::bind(insert_, next_, entry.at, kind, entry.evaluation, text, chain_);
  insert_.exec();
  ++next_;
}

void AppendEntry(SQLite::Database& db, const std::string& kind, int64_t row) {
  for (const EntrySource& source : EntrySources()) {
    if (source.kind != kind) continue;
    const std::optional<RecordEntry> entry = MakeEntry(db, source, row);
    if (entry.has_value()) RecordAppender(db).Append(kind, *entry);
  }
}

absl::Status Writer::AppendRecord(const std::string& kind, int64_t row) {
  AppendEntry(db_, kind, row);
  return absl::OkStatus();
}

absl::Status Writer::AppendKey(const std::string& public_pem) {
  if (IsLatestKey(db_, public_pem)) return absl::OkStatus();
  RecordAppender(db_).Append(kKeyEntry, MakeKeyEntry(now_ms_, public_pem));
  return absl::OkStatus();
}

int64_t Reader::RecordSize() {
  return db_.execAndGet("SELECT ifnull(max(id) + 1, 0) FROM record").getInt64();
}

Listed<RecordRow> Reader::Record(int64_t from, int64_t limit) {
  SQLite::Statement select(db_, absl::StrCat(kColumns, "WHERE id >= ? ORDER BY id LIMIT ?"));
  SQLite::bind(select, from, limit);
  return ListOf<RecordRow>(select, {}, RecordRowOf);
}

absl::StatusOr<RecordRow> Reader::GradedEntry(int64_t evaluation) {
  SQLite::Statement select(db_, absl::StrCat(kColumns, "WHERE evaluation = ? AND "
                                             "kind = 'graded' ORDER BY id LIMIT 1"));
  select.bind(1, evaluation);
  if (!select.executeStep()) {
    return absl::NotFoundError(
        absl::StrCat("the record has no result of evaluation ", evaluation));
  }
  RecordRow record;
  if (const StoredRow row = RecordRowOf(select, record); !row.ok()) return row.status();
  return record;
}

}  // namespace myograde::server
