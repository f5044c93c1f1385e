#include "server/store/journal.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr StoredRows<RecordRow, 3> kEntries = {
    .table = "record",
    .select = "SELECT entry, entry_json, chain FROM journal ",
    // A signed head has the last one.
    .wrong = [](const RecordRow& row) {
      return IsSha256Hex(row.chain) ? "" : "its \"chain\" is not 64 hexadecimal digits";
    }};

Act ActOf(SQLite::Statement& row) {
  Act act;
  act.id = row.getColumn(0).getInt64();
  act.at = row.getColumn(1).getInt64();
  act.kind = row.getColumn(2).getString();
  act.who = row.getColumn(3).getString();
  act.content = ParsedText(row.getColumn(4).getString());
  if (row.isColumnNull(5)) return act;
  act.entry = row.getColumn(5).getInt64();
  const Json entry = ParsedText(row.getColumn(6).getString());
  if (act.content.is_object() && entry.is_object()) act.content.update(entry);
  return act;
}

// What is wrong at an entry; "": nothing.
std::string ChainMistake(const std::string& before, const RecordRow* entry) {
  if (entry == nullptr) return "it is gone, or of another type";
  if (entry->chain == ExtendChain(before, entry->entry_json)) return "";
  return "its \"chain\" does not follow from the entry before: the record was changed here, behind "
         "the daemon's back";
}

}  // namespace

std::string ExtendChain(std::string_view before, std::string_view entry_json) {
  return Sha256Hex(absl::StrCat(std::string(before), "\n", std::string(entry_json)));
}

void AppendAct(SQLite::Database& db, int64_t now_ms, const NewAct& act) {
  Json beside = act.beside;
  int64_t index = -1;
  std::string text;
  std::string chain;
  if (act.is_public) {
    Json entry = act.content;
    entry.update({{"kind", act.kind}, {"at", TimeText(now_ms)}});
    text = CanonicalJson(entry);
    std::tie(index, chain) = FirstRow<int64_t, std::string>(db, R"(SELECT entry + 1, chain
        FROM journal WHERE entry BETWEEN 0 AND 1 << 40 ORDER BY entry DESC LIMIT 1)");
    chain = ExtendChain(chain, text);
  } else {
    beside.update(act.content);
  }
  Run(db, R"(INSERT INTO journal (at, kind, who, evaluation, private_json, entry, entry_json, chain)
      VALUES (?, ?, ?, nullif(?, 0), ?, nullif(?, -1), nullif(?, ''), nullif(?, '')))",
      now_ms, act.kind, act.who, act.evaluation, CanonicalJson(beside), index, text, chain);
}

void CatchUp(SQLite::Database& db, BoardState& state) {
  Statement select(db, R"(SELECT id, at, kind, who, private_json, entry, entry_json
      FROM journal WHERE id > ? ORDER BY id)",
                   state.last());
  while (select.executeStep()) (void)state.Add(ActOf(select));
}

std::shared_ptr<const BoardState> BoardFold::Follow(SQLite::Database& db) {
  const int64_t last = FirstValue<int64_t>(db, "SELECT max(id) FROM journal");
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
  if (board.last() > FirstValue<int64_t>(db, "SELECT max(id) FROM journal")) board = BoardState();
}

absl::StatusOr<bool> Journal::Mark(int64_t submission, const std::string& mark, bool set,
                                   const std::string& who, const std::string& why) {
  const auto [id, ranked] =
      FirstRow<int64_t, int64_t>(db_, "SELECT id, ranked FROM submission WHERE id = ?", submission);
  if (id == 0) return NoSuch("submission", submission);
  const std::vector<MarkRow>& history = Board().MarkHistory(submission);
  const auto last = std::find_if(history.rbegin(), history.rend(),
                                 [&](const MarkRow& row) { return row.mark == mark; });
  const bool is_set = last != history.rend() && last->set;
  if (is_set == set && (!set || why.empty() || last->why == why)) return false;
  nlohmann::json content = {{"submission", submission}, {"mark", mark}, {"set", set}};
  // Boards tell why somebody was disqualified, and nothing of the others.
  if (mark == kDisqualified) content["reason"] = why;
  Append({.kind = kMarkedAct,
          .who = who,
          .content = std::move(content),
          .beside = {{"why", why}},
          .is_public = ranked != 0});
  return true;
}

absl::StatusOr<bool> Journal::Choose(int64_t submission, const std::string& who) {
  const auto [id, done] = FirstRow<int64_t, int64_t>(db_, R"(SELECT s.id, s.ranked = 1 AND
      e.state = 'done' FROM submission AS s LEFT JOIN evaluation AS e ON e.submission = s.id
      AND e.kind = 'original' WHERE s.id = ?)",
                                                     submission);
  if (id == 0) return NoSuch("submission", submission);
  const auto& submissions = Board().submissions();
  const auto found = submissions.find(submission);
  if (done == 0 || found == submissions.end()) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", submission,
                     " can't be chosen: it is practice, or its evaluation is not "
                     "done; choose a ranked one that is"));
  }
  if (Board().NewestChoice(found->second.team, found->second.board) == submission) return false;
  Append({.kind = kChosenAct, .who = who, .content = {{"submission", submission}}});
  return true;
}

absl::StatusOr<bool> Journal::SetBoardConfig(const NewBoardConfig& change, const std::string& who) {
  const BoardName& board = change.board;
  const std::vector<BoardConfigRow>& rows = Board().ConfigsOf(board);
  if (change.rejudge == 0 && !rows.empty() && rows.back().config == change.config) return false;
  if (!change.config_json.empty()) {
    RETURN_IF_ERROR(Content(context_).AddText(kConfigs, change.config, change.config_json));
  }
  if (!AnyRow(db_, "SELECT 1 FROM config WHERE hash = ?", change.config)) {
    return absl::FailedPreconditionError(
        absl::StrCat("the store has no config ", change.config, " for a board to have"));
  }
  Append({.kind = kConfigAct,
          .who = who,
          .content = {{"phase", TextOrNull(board.phase)},
                      {"track", board.track},
                      {"profile", board.profile},
                      {"config", change.config},
                      {"rejudge", IdOrNull(change.rejudge)}}});
  return true;
}

absl::Status Journal::AppendKey(const std::string& public_pem) {
  if (Board().key() != public_pem) Append({kKeyAct, "daemon", {{"key", public_pem}}});
  return absl::OkStatus();
}

int64_t Journal::RecordSize() const {
  return FirstValue<int64_t>(
      db_, "SELECT max(entry) + 1 FROM journal WHERE entry BETWEEN 0 AND 1 << 40");
}

Listed<RecordRow> Journal::Record(int64_t from, int64_t limit) const {
  return kEntries.List(db_, "WHERE entry >= ? ORDER BY entry LIMIT ?", from, limit);
}

absl::StatusOr<RecordRow> Journal::GradedEntry(int64_t evaluation) const {
  return kEntries.First(
      db_, absl::NotFoundError(absl::StrCat("the record has no result of evaluation ", evaluation)),
      "WHERE evaluation = ? AND entry IS NOT NULL", evaluation);
}

void Journal::ForEachEntry(
    int64_t from, std::string chain,
    const std::function<bool(const RecordRow* entry, std::optional<Damage> damage)>& on_entry)
    const {
  Statement rows(db_, absl::StrCat(kEntries.select, "WHERE entry >= ? ORDER BY entry"), from);
  bool more = rows.executeStep();
  for (const int64_t size = RecordSize(); from < size; ++from) {
    absl::StatusOr<RecordRow> row = absl::NotFoundError("");
    if (more && rows.getColumn(0).getInt64() == from) {
      row = kEntries.Read(rows);
      more = rows.executeStep();
    }
    const RecordRow* entry = row.ok() ? &*row : nullptr;
    std::optional<Damage> damage;
    if (const std::string wrong = ChainMistake(chain, entry); !wrong.empty()) {
      damage = {"record", absl::StrCat(from), wrong};
    }
    if (!on_entry(entry, std::move(damage))) return;
    chain = row.ok() ? row->chain : "";
  }
}

}  // namespace myograde::server
