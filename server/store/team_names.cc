#include "server/store/team_names.h"

#include <utility>
#include <vector>

#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/base/names.h"
#include "server/store/quota.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr char kResembledKey[] = "myograde/resembled-team";

int64_t RowNamedExactly(SQLite::Database& db, const std::string& name) {
  return FirstValue<int64_t>(db, R"(SELECT id FROM team
      WHERE name = ?1 UNION ALL SELECT team_id FROM former_name WHERE name = ?1 LIMIT 1)",
                             name);
}

// The oldest other team that the name resembles, now or by a former name of its own; "": none.
std::string Resembled(SQLite::Database& db, const std::string& name, int64_t team) {
  const std::string sql = absl::StrCat(
      "SELECT t.name FROM team_skeleton AS l JOIN team AS t ON t.id = l.team "
      "WHERE l.skeleton = ?1 AND t.id NOT IN ",
      RowsOfTeam(2), " ORDER BY t.id LIMIT 1");
  for (const std::string& look : ConfusableSkeletons(name)) {
    std::string other = FirstValue<std::string>(db, sql, look, team);
    if (!other.empty()) return other;
  }
  return "";
}

}  // namespace

std::string RowsOfTeam(int place) {
  return absl::StrCat("(SELECT id FROM team WHERE id = ?", place, " OR merged_into = ?", place,
                      ")");
}

int64_t TeamRowNamed(SQLite::Database& db, const std::string& name) {
  // As given first: an old team may have a name that is rejected today.
  if (const int64_t row = RowNamedExactly(db, name); row != 0) return row;
  const absl::StatusOr<std::string> clean = CleanName(name, "the team's name");
  return clean.ok() ? RowNamedExactly(db, *clean) : 0;
}

absl::StatusOr<TeamInForce> TeamOfRow(SQLite::Database& db, int64_t row) {
  constexpr StoredRows<TeamInForce, 3> kInForce = {
      .table = "team",
      .select = "SELECT o.id, t.id AS merged_into, t.name, t.banned FROM team AS o "
                "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) ",
      .first = 1};
  const Damage missing = {"team", absl::StrCat(row), "it is missing, though another row names it"};
  return kInForce.First(db, DamagedRow(missing), "WHERE o.id = ?", row);
}

absl::StatusOr<TeamInForce> FindTeam(SQLite::Database& db, const std::string& name) {
  const int64_t row = TeamRowNamed(db, name);
  if (row != 0) return TeamOfRow(db, row);
  return absl::NotFoundError(absl::StrCat("there is no team \"", name, "\""));
}

absl::Status CheckNotConfusable(SQLite::Database& db, const std::string& clean, int64_t team) {
  const std::string other = Resembled(db, clean, team);
  if (other.empty()) return absl::OkStatus();
  absl::Status status = CodedRefusal(
      "look_alike",
      "the team's name looks like that of another team; choose another name, or write your "
      "team's exactly as it was first given");
  status.SetPayload(kResembledKey, absl::Cord(other));
  return status;
}

absl::StatusOr<std::string> TeamNamed(SQLite::Database& db, const std::string& name) {
  if (const int64_t row = TeamRowNamed(db, name); row != 0) {
    ASSIGN_OR_RETURN(const TeamInForce team, TeamOfRow(db, row));
    return team.name;
  }
  absl::StatusOr<std::string> clean = CleanName(name, "the team's name");
  if (!clean.ok()) return clean;
  RETURN_IF_ERROR(CheckNotConfusable(db, *clean, 0));
  return clean;
}

absl::Status CheckNotBanned(SQLite::Database& db, const BoardState& board,
                            const std::string& name) {
  const int64_t row = TeamRowNamed(db, name);
  if (row == 0) return absl::OkStatus();
  ASSIGN_OR_RETURN(const TeamInForce team, TeamOfRow(db, row));
  if (!team.banned) return absl::OkStatus();
  std::string why;
  for (const TeamEventRow& event : board.TeamEvents(team.id)) {
    if (event.event == "banned") why = event.why;
  }
  return CodedRefusal(
      kBannedCode,
      absl::StrCat("team \"", team.name, "\" is banned by the organisers",
                   why.empty() ? "" : absl::StrCat(" (", why, ")"),
                   ": nothing more is taken from it; what it has submitted stays readable for it"));
}

std::string ResembledTeam(const absl::Status& status) {
  return std::string(status.GetPayload(kResembledKey).value_or(absl::Cord()));
}

std::string KnownTeam(SQLite::Database& db, const std::string& name) {
  const absl::StatusOr<TeamInForce> team = FindTeam(db, name);
  return team.ok() ? team->name : name;
}

int64_t KnownTeamId(SQLite::Database& db, const std::string& name) {
  const absl::StatusOr<TeamInForce> team = FindTeam(db, name);
  return team.ok() ? team->id : 0;
}

void AddSkeletons(SQLite::Database& db, int64_t team, const std::string& name) {
  for (const std::string& look : ConfusableSkeletons(name)) {
    Run(db, "INSERT OR IGNORE INTO team_skeleton VALUES (?, ?)", look, team);
  }
}

void AddTeamEvent(SQLite::Database& db, int64_t now_ms, int64_t team, const std::string& event,
                  const std::string& detail, const std::string& who, const std::string& why) {
  const auto [name, into] =
      FirstRow<std::string, int64_t>(db, "SELECT name, merged_into FROM team WHERE id = ?", team);
  nlohmann::json content = {{"event", event}, {"team_id", team}, {"team", name}};
  if (event == "merged") content["into"] = into;
  AppendAct(db, now_ms,
            {.kind = kTeamAct,
             .who = who,
             .content = std::move(content),
             .beside = {{"detail", detail}, {"why", why}}});
}

int64_t AddTeam(SQLite::Database& db, const std::string& name, int64_t now_ms,
                const std::string& who, const std::string& why) {
  if (const int64_t row = RowNamedExactly(db, name); row != 0) return row;
  Run(db, "INSERT INTO team (name, created_at) VALUES (?, ?)", name, now_ms);
  const int64_t team = db.getLastInsertRowid();
  AddSkeletons(db, team, name);
  AddTeamEvent(db, now_ms, team, "created", "", who, why);
  return team;
}

void FillTeamSkeletons(SQLite::Database& db) {
  const std::string version = SkeletonVersion();
  const bool fits = Meta(db, "team_skeletons") == version;
  if (!fits) db.exec("DELETE FROM team_skeleton");
  Statement select(db, R"(WITH bare AS (SELECT id FROM team AS t
      WHERE NOT EXISTS (SELECT 1 FROM team_skeleton WHERE team = t.id)) SELECT id, name FROM team
      WHERE id IN bare UNION ALL SELECT team_id, name FROM former_name WHERE team_id IN bare)");
  std::vector<std::pair<int64_t, std::string>> teams;
  while (select.executeStep()) {
    teams.emplace_back(select.getColumn(0).getInt64(), select.getColumn(1).getString());
  }
  for (const auto& [team, name] : teams) AddSkeletons(db, team, name);
  if (!fits) SetMeta(db, "team_skeletons", version);
}

}  // namespace myograde::server
