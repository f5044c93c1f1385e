#include "server/store/context.h"

#include "protocol/base/config_reader.h"
#include "server/store/connection.h"
#include "server/store/journal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

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
  const std::string chain = ExtendChain(any ? last.getColumn(1).getString() : "", text);
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

void ForgetRolledBack(SQLite::Database& db, BoardState& board) {
  if (board.last() > FirstNumber(db, "SELECT max(id) FROM journal")) board = BoardState();
}

const BoardState& TransactionContext::Board() const {
  if (state != nullptr) {
    CatchUp(db, *state);
    return *state;
  }
  if (followed == nullptr) followed = fold->Follow(db);
  return *followed;
}

absl::Status StorePart::Audit(const char* entity, int64_t id, std::string_view from,
                              std::string_view to, const std::string& who, const std::string& why) {
  Run(db_, R"(INSERT INTO transition (at, entity, entity_id, from_state, to_state, who, why)
      VALUES (?, ?, ?, ?, ?, ?, ?))",
      now_ms_, entity, id, from, to, who, why);
  return absl::OkStatus();
}

absl::Status TransactionContext::Part(const std::function<absl::Status()>& change) const {
  db.exec("SAVEPOINT part");
  absl::Status status;
  try {
    status = change();
  } catch (const SQLite::Exception& error) {
    status = StatusOf("the store", error);
    if (!absl::IsFailedPrecondition(status)) throw;  // not just of this part
  }
  if (!status.ok()) {
    db.exec("ROLLBACK TO part");
    ForgetRolledBack(db, *state);
  }
  db.exec("RELEASE part");
  return status;
}

}  // namespace myograde::server
