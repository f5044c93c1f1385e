// Bearer tokens, as hashes.
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/quota.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr int64_t kMinuteMs = 60 * 1000;
constexpr char kParticipant[] = "participant";

constexpr char kTokenColumns[] =
    "SELECT k.id, k.role, t.name, k.label, k.created_at, k.created_by, k.expires_at, "
    "k.revoked_at, k.revoked_by, k.last_used_at, k.team_id FROM token AS k "
    "LEFT JOIN team AS o ON o.id = k.team_id "
    "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) ";

StoredRow TokenOf(SQLite::Statement& select, TokenRow& token) {
  StoredRow row(select, "token", Shown(select.getColumn(0)));
  token.id = row.Number(0, 1, INT64_MAX);
  token.role = row.OneOf(1, {kParticipant, "organiser", "operator"});
  token.label = row.Text(3);
  token.created_at = row.Time(4);
  token.created_by = row.Text(5);
  token.expires_at = row.TimeOr0(6);
  token.revoked_at = row.TimeOr0(7);
  token.revoked_by = row.TextOr(8);
  token.last_used_at = row.TimeOr0(9);
  if (select.isColumnNull(7) != select.isColumnNull(8)) {
    row.Fail(7, "who revoked it says otherwise");
  }
  if (select.isColumnNull(10) == (token.role == kParticipant)) {
    row.Fail(10, "its role says otherwise");
  }
  if (token.role == kParticipant) {
    row.Joined("team", 10);
    token.team = row.Text(2);
  }
  return row;
}

absl::StatusOr<TokenRow> OneToken(SQLite::Statement& select, const std::string& missing) {
  if (!select.executeStep()) return absl::NotFoundError(missing);
  TokenRow token;
  if (const StoredRow row = TokenOf(select, token); !row.ok()) return row.status();
  return token;
}

}  // namespace

absl::StatusOr<int64_t> Writer::AddToken(const NewToken& token, const std::string& who) {
  const bool participant = token.role == kParticipant;
  if (participant == token.team.empty()) {
    return absl::InvalidArgumentError("a participant's token has a team, and no other token has");
  }
  if (token.expires_at != 0 && token.expires_at <= now_ms_) {
    return absl::InvalidArgumentError("the token would have expired already; choose a later time");
  }
  SQLite::Statement insert(
      db_, "INSERT INTO token (hash, role, team_id, label, created_at, created_by, expires_at) "
           "VALUES (?, ?, ?, ?, ?, ?, nullif(?, 0))");
  insert.bind(1, token.hash);
  insert.bind(2, token.role);
  insert.bind(4, token.label);
  insert.bind(5, now_ms_);
  insert.bind(6, who);
  insert.bind(7, token.expires_at);
  if (participant) {
    const absl::StatusOr<TeamInForce> team = FindTeam(db_, token.team);
    if (absl::IsNotFound(team.status())) {
      return WithErrorCode(absl::NotFoundError(absl::StrCat(team.status().message(),
                                                            "; create it first")),
                           "unknown_team");
    }
    if (!team.ok()) return team.status();
    insert.bind(3, team->id);
  }
  insert.exec();
  return db_.getLastInsertRowid();
}

absl::StatusOr<bool> Writer::RevokeToken(int64_t id, const std::string& who) {
  const absl::Status there = Reader(db_).Token(id).status();
  if (absl::IsNotFound(there)) return there;
  // A damaged row is revoked as well, if the schema takes it.
  SQLite::Statement update(db_, "UPDATE token SET revoked_at = ?, revoked_by = ? WHERE id = ? AND "
                                "revoked_at IS NULL");
  SQLite::bind(update, now_ms_, who, id);
  return update.exec() == 1;
}

absl::Status Writer::TouchToken(int64_t id) {
  SQLite::Statement update(db_, "UPDATE token SET last_used_at = ?1 WHERE id = ?2 AND "
                                "(last_used_at IS NULL OR last_used_at < ?1)");
  SQLite::bind(update, now_ms_ - now_ms_ % kMinuteMs, id);
  update.exec();
  return absl::OkStatus();
}

absl::StatusOr<TokenRow> Reader::TokenByHash(const std::string& sha256) {
  SQLite::Statement select(db_, absl::StrCat(kTokenColumns, "WHERE k.hash = ?"));
  select.bind(1, sha256);
  return OneToken(select, "there is no such token");
}

absl::StatusOr<TokenRow> Reader::Token(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kTokenColumns, "WHERE k.id = ?"));
  select.bind(1, id);
  return OneToken(select, absl::StrCat("there is no token ", id));
}

Listed<TokenRow> Reader::Tokens(int64_t before, int64_t limit) {
  SQLite::Statement select(
      db_, absl::StrCat(kTokenColumns, "WHERE k.id < ? ORDER BY k.id DESC LIMIT ?"));
  SQLite::bind(select, before, limit);
  return ListOf<TokenRow>(select, {}, TokenOf);
}

}  // namespace myograde::server
