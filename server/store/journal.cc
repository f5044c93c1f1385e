#include "server/store/journal.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kEntriesAtATime = 10'000;
constexpr char kEntryColumns[] = "SELECT entry, entry_json, chain FROM journal ";

StoredRow RecordRowOf(SQLite::Statement& select, RecordRow& record) {
  StoredRow row(select, "record");
  record.index = row.Number(0, 0, kMany);
  record.entry_json = row.Object(1);
  record.chain = row.Hash(2);
  return row;
}

Act ActOf(SQLite::Statement& row) {
  Act act;
  act.id = row.getColumn(0).getInt64();
  act.at = row.getColumn(1).getInt64();
  act.kind = row.getColumn(2).getString();
  act.who = row.getColumn(3).getString();
  act.content = Json::parse(row.getColumn(4).getString(), nullptr, /*allow_exceptions=*/false);
  if (row.isColumnNull(5)) return act;
  act.entry = row.getColumn(5).getInt64();
  const Json entry = Json::parse(row.getColumn(6).getString(), nullptr, /*allow_exceptions=*/false);
  if (act.content.is_object() && entry.is_object()) act.content.update(entry);
  return act;
}

}  // namespace

void AppendAct(SQLite::Database& db, int64_t now_ms, const NewAct& act) {
  if (!act.is_public) {
    Json beside = act.content;
    beside.update(act.beside);
    Run(db, R"(INSERT INTO journal (at, kind, who, evaluation, private_json)
        VALUES (?, ?, ?, nullif(?, 0), ?))",
        now_ms, act.kind, act.who, act.evaluation, CanonicalJson(beside));
    return;
  }
  Statement last(db, R"(SELECT entry + 1, chain
      FROM journal WHERE entry BETWEEN 0 AND 1 << 40 ORDER BY entry DESC LIMIT 1)");
  const bool any = last.executeStep();
  Json entry = act.content;
  entry["kind"] = act.kind;
  entry["at"] = TimeText(now_ms);
  const std::string text = CanonicalJson(entry);
  const std::string chain = ChainOf(any ? last.getColumn(1).getString() : "", text);
  Run(db, R"(INSERT INTO journal (at, kind, who, evaluation, private_json, entry, entry_json, chain)
      VALUES (?, ?, ?, nullif(?, 0), ?, ?, ?, ?))",
      now_ms, act.kind, act.who, act.evaluation, CanonicalJson(act.beside),
      any ? last.getColumn(0).getInt64() : 0, text, chain);
}

void CatchUp(SQLite::Database& db, BoardState& state) {
  Statement select(db, R"(SELECT id, at, kind, who, private_json, entry, entry_json
      FROM journal WHERE id > ? ORDER BY id)",
                   state.last());
  while (select.executeStep()) (void)state.Add(ActOf(select));
}

std::shared_ptr<const BoardState> BoardFold::Follow(SQLite::Database& db) {
  const int64_t last = FirstNumber(db, "SELECT max(id) FROM journal");
  const MutexLock lock(mutex_);
  if (state_ != nullptr && state_->last() == last) return state_;
  // Another connection may have seen more.
  const bool behind = state_ != nullptr && state_->last() > last;
  auto state = behind || state_ == nullptr ? std::make_shared<BoardState>()
                                           : std::make_shared<BoardState>(*state_);
  CatchUp(db, *state);
  if (!behind) state_ = state;
  return state;
}

std::string ChainOf(std::string_view before, std::string_view entry_json) {
  Sha256 hash;
  hash.Update(before);
  hash.Update("\n");
  hash.Update(entry_json);
  return hash.FinishHex();
}

std::string ChainMistake(const std::string& before, const RecordRow* entry) {
  if (entry == nullptr) return "it is gone, or of another type";
  if (entry->chain == ChainOf(before, entry->entry_json)) return "";
  return "its \"chain\" does not follow from the entry before: the record was changed here, behind "
         "the daemon's back";
}

absl::Status Writer::AppendKey(const std::string& public_pem) {
  if (Board().key() != public_pem) Append({kKeyAct, "daemon", {{"key", public_pem}}});
  return absl::OkStatus();
}

int64_t Reader::RecordSize() {
  return FirstNumber(
      db_, "SELECT max(entry) + 1 FROM journal WHERE entry BETWEEN 0 AND 1 << 40");
}

Listed<RecordRow> Reader::Record(int64_t from, int64_t limit) {
  return ListOf<RecordRow>(
      Statement(db_, absl::StrCat(kEntryColumns, "WHERE entry >= ? ORDER BY entry LIMIT ?"), from,
                limit),
      RecordRowOf);
}

absl::StatusOr<RecordRow> Reader::GradedEntry(int64_t evaluation) {
  return FirstOf<RecordRow>(
      Statement(db_, absl::StrCat(kEntryColumns, "WHERE evaluation = ? AND entry IS NOT NULL"),
                evaluation),
      RecordRowOf,
      absl::NotFoundError(absl::StrCat("the record has no result of evaluation ", evaluation)));
}

absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most) {
  std::vector<Damage> damaged;
  RETURN_IF_ERROR(readers.Read([&](Reader& reader) {
    const int64_t size = reader.RecordSize();
    std::string chain;
    int64_t next = 0;
    const auto add = [&](const RecordRow* entry) {
      std::string mistake = ChainMistake(chain, entry);
      if (!mistake.empty() && damaged.size() < most) {
        damaged.push_back({"record", absl::StrCat(next), std::move(mistake)});
      }
      chain = entry == nullptr ? "" : entry->chain;
      ++next;
    };
    while (next < size && damaged.size() < most) {
      const int64_t end = std::min(size, next + kEntriesAtATime);
      for (const RecordRow& row : reader.Record(next, end - next).rows) {
        while (next < row.index && next < size) add(nullptr);
        add(&row);
      }
      while (next < end) add(nullptr);
    }
    return absl::OkStatus();
  }));
  return damaged;
}

}  // namespace myograde::server
