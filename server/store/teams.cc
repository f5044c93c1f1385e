#include "server/store/teams.h"

#include <utility>
#include <vector>

#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>

#include "server/base/names.h"
#include "server/store/quota.h"
#include "server/store/reader.h"

namespace myograde::server {
namespace {

constexpr char kResembledKey[] = "myograde/resembled-team";

bool IsThere(SQLite::Database& db, const std::string& name) {
  SQLite::Statement select(db, "SELECT 1 FROM team WHERE name = ?");
  select.bind(1, name);
  return select.executeStep();
}

void AddLooks(SQLite::Database& db, int64_t team, const std::string& name) {
  SQLite::Statement insert(db, "INSERT OR IGNORE INTO team_look VALUES (?, ?)");
  for (const std::string& look : LooksOf(name)) {
    insert.reset();
    SQLite::bind(insert, look, team);
    insert.exec();
  }
}

// The oldest team that the name resembles; "": none.
std::string Resembled(SQLite::Database& db, const std::string& name) {
  SQLite::Statement select(db, "SELECT t.name FROM team_look AS l JOIN team AS t ON t.id = l.team "
                               "WHERE l.look = ? ORDER BY t.id LIMIT 1");
  for (const std::string& look : LooksOf(name)) {
    select.reset();
    select.bind(1, look);
    if (select.executeStep()) return select.getColumn(0).getString();
  }
  return "";
}

}  // namespace

absl::StatusOr<std::string> TeamNamed(SQLite::Database& db, const std::string& name) {
  // Look it up as given first: an old team may have a name that is rejected today.
  if (IsThere(db, name)) return name;
  absl::StatusOr<std::string> clean = CleanName(name, "the team's name");
  if (!clean.ok() || IsThere(db, *clean)) return clean;
  const std::string other = Resembled(db, *clean);
  if (other.empty()) return clean;
  absl::Status status = WithErrorCode(
      absl::FailedPreconditionError(
          "the team's name looks like that of another team; choose another name, or write your "
          "team's exactly as it was first given"),
      "look_alike");
  status.SetPayload(kResembledKey, absl::Cord(other));
  return status;
}

std::string ResembledTeam(const absl::Status& status) {
  return std::string(status.GetPayload(kResembledKey).value_or(absl::Cord()));
}

std::string KnownTeam(SQLite::Database& db, const std::string& name) {
  if (name.empty() || IsThere(db, name)) return name;
  const absl::StatusOr<std::string> clean = CleanName(name, "the team's name");
  return clean.ok() && IsThere(db, *clean) ? *clean : name;
}

void AddTeam(SQLite::Database& db, const std::string& name, int64_t now_ms) {
  SQLite::Statement insert(db, "INSERT INTO team (name, created_at) VALUES (?, ?) "
                               "ON CONFLICT DO NOTHING");
  SQLite::bind(insert, name, now_ms);
  if (insert.exec() == 1) AddLooks(db, db.getLastInsertRowid(), name);
}

void FillTeamLooks(SQLite::Database& db) {
  const std::string version = LooksVersion();
  SQLite::Statement made(db, "SELECT CAST(value AS TEXT) FROM meta WHERE key = 'team_looks'");
  const bool fits = made.executeStep() && made.getColumn(0).getString() == version;
  if (!fits) db.exec("DELETE FROM team_look");
  SQLite::Statement select(db, "SELECT id, name FROM team WHERE NOT EXISTS "
                               "(SELECT 1 FROM team_look WHERE team = team.id)");
  std::vector<std::pair<int64_t, std::string>> teams;
  while (select.executeStep()) {
    teams.emplace_back(select.getColumn(0).getInt64(), select.getColumn(1).getString());
  }
  for (const auto& [team, name] : teams) AddLooks(db, team, name);
  if (fits) return;
  SQLite::Statement set(db, "INSERT INTO meta VALUES ('team_looks', CAST(? AS BLOB)) "
                            "ON CONFLICT (key) DO UPDATE SET value = excluded.value");
  set.bind(1, version);
  set.exec();
}

absl::Status Reader::CheckTeam(const std::string& team) { return TeamNamed(db_, team).status(); }

std::string Reader::TeamOf(const std::string& name) { return KnownTeam(db_, name); }

}  // namespace myograde::server
