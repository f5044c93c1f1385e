#include <utility>

#include <absl/strings/str_cat.h>

#include "server/base/error_code.h"
#include "server/store/callers.h"
#include "server/store/stored_row.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

constexpr StoredRows<AccessEventRow, 9> kEvents = {
    .table = "access_event",
    .select = "SELECT id, at, kind, who, role, action, subject, detail, count FROM access_event ",
    .wrong = [](const AccessEventRow& event) {
      if (event.kind != "denied" && event.kind != "act") return "its \"kind\" is none";
      return event.count > 0 ? "" : "its \"count\" is 0";
    }};

constexpr int64_t kMsOfADay = 24 * 60 * 60 * 1000;

// Adds to the count of the day's row of equal denials. False: there is none.
bool CountDenial(SQLite::Database& db, const AccessEventRow& event, int64_t now_ms) {
  return Run(db, R"(UPDATE access_event SET count = count + ?1 WHERE id = (SELECT id
      FROM access_event WHERE kind = 'denied' AND at BETWEEN ?2 AND ?2 + ?3 - 1
      AND who = ?4 AND role = ?5 AND action = ?6 AND subject = ?7 AND detail = ?8 LIMIT 1))",
             event.count, now_ms / kMsOfADay * kMsOfADay, kMsOfADay, event.who, event.role,
             event.action, event.subject, event.detail) > 0;
}

bool IsDayFull(SQLite::Database& db, int64_t now_ms) {
  return AnyRow(db, R"(SELECT 1 FROM access_event WHERE kind = 'denied'
      AND at BETWEEN ?1 AND ?1 + ?2 - 1 LIMIT 1 OFFSET ?3)",
                now_ms / kMsOfADay * kMsOfADay, kMsOfADay, kMostDenialsOfADay - 1);
}

constexpr int64_t kMinuteMs = 60 * 1000;
constexpr char kParticipant[] = "participant";

// One that is damaged gives no rights.
constexpr StoredRows<TokenRow, 10> kTokens = {
    .table = "token",
    .select =
        "SELECT k.id, k.role, iif(k.team_id IS NULL, '', t.name) AS team, k.label, k.created_at, "
        "k.created_by, ifnull(k.expires_at, 0), ifnull(k.revoked_at, 0), ifnull(k.revoked_by, ''), "
        "ifnull(k.last_used_at, 0) FROM token AS k LEFT JOIN team AS o ON o.id = k.team_id "
        "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) ",
    .wrong = [](const TokenRow& token) {
      const bool participant = token.role == kParticipant;
      if (!participant && token.role != "organiser" && token.role != "operator") {
        return "its \"role\" is none";
      }
      if (participant == token.team.empty()) return "its \"role\" does not fit its team";
      return (token.revoked_at == 0) == token.revoked_by.empty()
                 ? ""
                 : "its \"revoked_at\" and its \"revoked_by\" contradict each other";
    }};

}  // namespace

absl::Status Callers::AddDenial(AccessEventRow event, const AccessEventRow& others) {
  event.kind = "denied";
  if (CountDenial(db_, event, now_ms_)) return absl::OkStatus();
  if (IsDayFull(db_, now_ms_)) {
    const int64_t count = std::exchange(event, others).count;
    event.kind = "denied";
    event.count = count;
    if (CountDenial(db_, event, now_ms_)) return absl::OkStatus();
  }
  return AddEvent(event);
}

void Callers::RemoveDenials(int64_t before_ms) {
  Run(db_, R"(DELETE FROM access_event WHERE id IN (SELECT id
      FROM access_event WHERE kind = 'denied' AND at < ? ORDER BY at LIMIT 10000))",
      before_ms);
}

absl::Status Callers::AddEvent(const AccessEventRow& event) {
  Run(db_, R"(INSERT INTO access_event (at, kind, who, role, action, subject, detail, count)
      VALUES (?, ?, ?, ?, ?, ?, ?, ?))",
      now_ms_, event.kind, event.who, event.role, event.action, event.subject, event.detail,
      event.count);
  return absl::OkStatus();
}

Listed<AccessEventRow> Callers::Events(const std::string& kind, int64_t before,
                                       int64_t limit) const {
  return kEvents.List(db_, "WHERE id < ?1 AND (?2 = '' OR kind = ?2) ORDER BY id DESC LIMIT ?3",
                      before, kind, limit);
}

absl::StatusOr<int64_t> Callers::AddToken(const std::string& sha256, const TokenRow& token,
                                          const std::string& who) {
  const bool participant = token.role == kParticipant;
  if (participant == token.team.empty()) {
    return absl::InvalidArgumentError("a participant's token has a team, and no other token has");
  }
  if (token.expires_at != 0 && token.expires_at <= now_ms_) {
    return absl::InvalidArgumentError("the token would have expired already; choose a later time");
  }
  int64_t team = 0;
  if (participant) {
    const absl::StatusOr<TeamInForce> found = Teams(context_).Named(token.team);
    if (absl::IsNotFound(found.status())) {
      return WithErrorCode(
          absl::NotFoundError(absl::StrCat(found.status().message(), "; create it first")),
          "unknown_team");
    }
    if (!found.ok()) return found.status();
    team = found->id;
  }
  Run(db_, R"(INSERT INTO token (hash, role, team_id, label, created_at, created_by, expires_at)
      VALUES (?, ?, nullif(?, 0), ?, ?, ?, nullif(?, 0)))",
      sha256, token.role, team, token.label, now_ms_, who, token.expires_at);
  return db_.getLastInsertRowid();
}

absl::StatusOr<bool> Callers::RevokeToken(int64_t id, const std::string& who) {
  const absl::Status there = Token(id).status();
  if (absl::IsNotFound(there)) return there;
  // A damaged row is revoked as well, if the schema takes it.
  return Run(db_, R"(UPDATE token
      SET revoked_at = ?, revoked_by = ? WHERE id = ? AND revoked_at IS NULL)",
             now_ms_, who, id) == 1;
}

absl::Status Callers::TouchToken(int64_t id) {
  Run(db_, R"(UPDATE token
      SET last_used_at = ?1 WHERE id = ?2 AND (last_used_at IS NULL OR last_used_at < ?1))",
      now_ms_ - now_ms_ % kMinuteMs, id);
  return absl::OkStatus();
}

absl::StatusOr<TokenRow> Callers::TokenByHash(const std::string& sha256) const {
  return kTokens.First(db_, absl::NotFoundError("there is no such token"), "WHERE k.hash = ?",
                       sha256);
}

absl::StatusOr<TokenRow> Callers::Token(int64_t id) const {
  return kTokens.First(db_, NoSuch("token", id), "WHERE k.id = ?", id);
}

Listed<TokenRow> Callers::Tokens(int64_t before, int64_t limit) const {
  return kTokens.List(db_, "WHERE k.id < ? ORDER BY k.id DESC LIMIT ?", before, limit);
}

}  // namespace myograde::server
