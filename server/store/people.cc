// Teams and who belongs to them.
#include <algorithm>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/names.h"
#include "server/store/connection.h"
#include "server/store/quota.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

// Memberships in force: the newest row of each team and person.
constexpr char kMemberships[] =
    "FROM member AS m WHERE m.id = (SELECT max(id) FROM member WHERE team_id IS m.team_id AND "
    "person IS m.person) AND m.belongs = 1 ";

absl::Status Conflict(const std::string& sentence) {
  return absl::FailedPreconditionError(sentence);
}

absl::Status Forbid(const std::string& sentence) {
  return WithErrorCode(absl::FailedPreconditionError(sentence), kForbiddenCode);
}

bool Belongs(SQLite::Database& db, int64_t team, const std::string& person) {
  SQLite::Statement select(db, absl::StrCat("SELECT 1 ", kMemberships,
                                            "AND m.team_id = ? AND m.person = ?"));
  SQLite::bind(select, team, person);
  return select.executeStep();
}

void AddMember(SQLite::Database& db, int64_t now_ms, int64_t team, const std::string& person,
               bool belongs, const std::string& who) {
  SQLite::Statement insert(db, "INSERT INTO member (at, team_id, person, belongs, who) "
                               "VALUES (?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms, team, person, belongs ? 1 : 0, who);
  insert.exec();
}

// Uploads that nobody has submitted count by the name of their team.
void RenameUploads(SQLite::Database& db, const std::string& from, const std::string& to) {
  SQLite::Statement update(db, "UPDATE upload SET team = ? WHERE team = ?");
  SQLite::bind(update, to, from);
  update.exec();
}

// FailedPreconditionError if a team of the row 0 (a new one), or another one, can't have the name.
absl::Status CheckFree(SQLite::Database& db, const std::string& clean, int64_t team) {
  const int64_t row = TeamRowNamed(db, clean);
  if (row == 0) return CheckLooks(db, clean, team);
  if (row == team) return absl::OkStatus();  // a former name of its own
  ASSIGN_OR_RETURN(const TeamInForce holder, TeamOfRow(db, row));
  if (team != 0 && holder.id == team) {
    return Conflict(absl::StrCat("\"", clean, "\" is the name of a team that was merged into \"",
                               holder.name, "\", and keeps finding it; choose another name"));
  }
  return Conflict(holder.name == clean
                    ? absl::StrCat("there is a team \"", clean, "\" already; choose another name")
                    : absl::StrCat("\"", clean, "\" is a former name of team \"", holder.name,
                                   "\", and keeps finding it; choose another name"));
}

// "team "a" and team "b"".
std::string TeamList(const std::set<std::string>& teams) {
  return absl::StrJoin(teams, " and ", [](std::string* out, const std::string& team) {
    absl::StrAppend(out, "team \"", team, "\"");
  });
}

// The team that the name finds, if it is not that of a team that was merged into it.
absl::StatusOr<TeamInForce> Unmerged(SQLite::Database& db, const std::string& name) {
  const absl::StatusOr<TeamInForce> team = FindTeam(db, name);
  if (!team.ok() || team->id == TeamRowNamed(db, name)) return team;
  return Conflict(absl::StrCat("team \"", name, "\" was merged into team \"", team->name,
                             "\" already; name that one"));
}

// The two teams of a merge.
struct MergePair {
  TeamInForce from;
  TeamInForce to;
};

absl::StatusOr<MergePair> Mergeable(SQLite::Database& db, const std::string& team,
                                    const std::string& into) {
  ASSIGN_OR_RETURN(const TeamInForce from, Unmerged(db, team));
  ASSIGN_OR_RETURN(const TeamInForce to, Unmerged(db, into));
  if (from.id == to.id) {
    return Conflict(absl::StrCat("team \"", from.name, "\" can't be merged into itself"));
  }
  for (const TeamInForce& one : {from, to}) {
    if (!one.banned) continue;
    return Conflict(absl::StrCat("team \"", one.name, "\" is banned, and a merge would hide that; "
                               "unban it first"));
  }
  return MergePair{from, to};
}

std::vector<std::string> MembersOf(SQLite::Database& db, int64_t team) {
  SQLite::Statement select(
      db, absl::StrCat("SELECT m.person ", kMemberships, "AND m.team_id = ? ORDER BY m.person"));
  select.bind(1, team);
  std::vector<std::string> members;
  while (select.executeStep()) members.push_back(select.getColumn(0).getString());
  return members;
}

}  // namespace

absl::StatusOr<std::string> Writer::CreateTeam(const std::string& team, const std::string& who,
                                               const std::string& why) {
  absl::StatusOr<std::string> clean = CleanName(team, "the team's name");
  absl::Status status = clean.status();
  if (status.ok()) status = CheckFree(db_, *clean, 0);
  if (!status.ok()) return status;
  AddTeam(db_, *clean, now_ms_, who, why);
  return clean;
}

absl::Status Writer::FoundTeam(const std::string& team, const std::string& person, int64_t most) {
  ASSIGN_OR_RETURN(const std::string name, TeamNamed(db_, team));
  std::set<std::string> teams = Reader(db_).TeamsOf(person);
  if (teams.contains(name)) return absl::OkStatus();
  // Also of teams that were merged into it, and those who were removed; a team may also be of people
  // with tokens, or of somebody for whom an organiser submits.
  const std::string rows = RowsOfTeam(1);
  SQLite::Statement others(
      db_, absl::StrCat("SELECT 1 FROM member WHERE team_id IN ", rows,
                        " UNION ALL SELECT 1 FROM token WHERE team_id IN ", rows,
                        " UNION ALL SELECT 1 FROM submission WHERE team_id IN ", rows,
                        " AND accepted_by != ?2 LIMIT 1"));
  SQLite::bind(others, KnownTeamId(db_, name), person);
  if (others.executeStep()) {
    return Forbid(absl::StrCat("team \"", name, "\" belongs to others, and ", person,
                               " is no member of it; choose another name, or ask an organiser to "
                               "add you"));
  }
  if (std::ssize(teams) >= most) {
    return Forbid(absl::StrCat(person, " belongs to ", TeamList(teams), ", and one person may "
                               "belong to ", Counted(most, "team"), "; go on with ",
                               teams.size() == 1 ? "that one" : "one of those",
                               ", or ask an organiser"));
  }
  AddMember(db_, now_ms_, AddTeam(db_, name, now_ms_, person), person, true, person);
  return absl::OkStatus();
}

absl::StatusOr<bool> Writer::RenameTeam(const std::string& team, const std::string& name,
                                        const std::string& who, const std::string& why) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  ASSIGN_OR_RETURN(const std::string clean, CleanName(name, "the team's new name"));
  if (clean == found.name) return false;
  RETURN_IF_ERROR(CheckFree(db_, clean, found.id));
  MendBoardState();
  SQLite::Statement taken(db_, "DELETE FROM former_name WHERE name = ? AND team_id = ?");
  SQLite::bind(taken, clean, found.id);
  taken.exec();
  SQLite::Statement update(db_, "UPDATE team SET name = ? WHERE id = ?");
  SQLite::bind(update, clean, found.id);
  update.exec();
  SQLite::Statement former(db_, "INSERT INTO former_name (name, team_id) VALUES (?, ?)");
  SQLite::bind(former, found.name, found.id);
  former.exec();
  AddLooks(db_, found.id, clean);
  RenameUploads(db_, found.name, clean);
  AddTeamEvent(db_, {.at = now_ms_, .event = "renamed", .detail = found.name, .who = who,
                     .why = why}, found.id);
  return true;
}

absl::StatusOr<bool> Writer::SetMember(const std::string& team, const std::string& person,
                                       bool belongs, const std::string& who) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  if (Belongs(db_, found.id, person) == belongs) return false;
  AddMember(db_, now_ms_, found.id, person, belongs, who);
  return true;
}

absl::Status Writer::MergeTeams(const std::string& team, const std::string& into,
                                const std::string& who, const std::string& why) {
  ASSIGN_OR_RETURN(const MergePair pair, Mergeable(db_, team, into));
  const auto& [from, to] = pair;
  MendBoardState();
  // Teams that were merged into the first follow it, so that no row leads to another merged one.
  SQLite::Statement update(
      db_, "UPDATE team SET merged_into = ?1 WHERE id = ?2 OR merged_into = ?2");
  SQLite::bind(update, to.id, from.id);
  update.exec();
  for (const std::string& person : MembersOf(db_, from.id)) {
    AddMember(db_, now_ms_, from.id, person, false, who);
    if (!Belongs(db_, to.id, person)) AddMember(db_, now_ms_, to.id, person, true, who);
  }
  RenameUploads(db_, from.name, to.name);
  AddTeamEvent(db_, {.at = now_ms_, .event = "merged", .detail = to.name, .who = who,
                     .why = why}, from.id);
  return absl::OkStatus();
}

absl::StatusOr<bool> Writer::BanTeam(const std::string& team, bool banned, const std::string& who,
                                     const std::string& why) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  if (found.banned == banned) return false;
  MendBoardState();
  SQLite::Statement update(db_, "UPDATE team SET banned = ? WHERE id = ?");
  SQLite::bind(update, banned ? 1 : 0, found.id);
  update.exec();
  AddTeamEvent(db_, {.at = now_ms_, .event = banned ? "banned" : "unbanned", .who = who,
                     .why = why}, found.id);
  return true;
}

absl::Status Reader::CheckMerge(const std::string& team, const std::string& into) {
  return Mergeable(db_, team, into).status();
}

std::set<std::string> Reader::TeamsOf(const std::string& person) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT m.id, m.team_id ", kMemberships, "AND m.person = ?"));
  select.bind(1, person);
  std::set<std::string> teams;
  while (select.executeStep()) {
    StoredRow row(select, "member", Shown(select.getColumn(0)));
    const int64_t id = row.Number(1, 1, INT64_MAX);
    const absl::StatusOr<TeamInForce> team = TeamOfRow(db_, id);
    if (row.ok() && team.ok()) teams.insert(team->name);
  }
  return teams;
}

namespace {

constexpr char kTeamColumns[] =
    "SELECT t.id, t.name, t.created_at, t.banned, t.merged_into, g.name FROM team AS t "
    "LEFT JOIN team AS g ON g.id = t.merged_into ";

StoredRow TeamRowOf(SQLite::Statement& select, TeamRow& team) {
  StoredRow row(select, "team", Shown(select.getColumn(0)));
  team.id = row.Number(0, 1, INT64_MAX);
  team.name = row.Text(1);
  team.created_at = row.Time(2);
  team.banned = row.Flag(3);
  if (!select.isColumnNull(4)) {
    row.Joined("team", 4);
    team.merged_into = row.Text(5);
  }
  return row;
}

// By a team's id, the texts that the two columns of a query give; unreadable ones are left out.
std::map<int64_t, std::vector<std::string>> TextsByTeam(SQLite::Database& db,
                                                        const std::string& sql) {
  SQLite::Statement select(db, sql);
  std::map<int64_t, std::vector<std::string>> texts;
  while (select.executeStep()) {
    StoredRow row(select, "team", Shown(select.getColumn(0)));
    const int64_t team = row.Number(0, 1, INT64_MAX);
    std::string text = row.Text(1);
    if (row.ok()) texts[team].push_back(std::move(text));
  }
  return texts;
}

StoredRow TeamEventOf(SQLite::Statement& select, TeamEventRow& event) {
  StoredRow row(select, "team_event", Shown(select.getColumn(0)));
  event.id = row.Number(0, 1, INT64_MAX);
  event.at = row.Time(1);
  event.event = row.OneOf(2, {"created", "renamed", "merged", "banned", "unbanned"});
  event.detail = row.Text(3);
  event.who = row.Text(4);
  event.why = row.Text(5);
  row.Joined("team", 6);
  event.team = row.Text(7);
  return row;
}

}  // namespace

Listed<TeamRow> Reader::Teams(int64_t before, int64_t limit) {
  SQLite::Statement select(
      db_, absl::StrCat(kTeamColumns, "WHERE t.id < ? ORDER BY t.id DESC LIMIT ?"));
  SQLite::bind(select, before, limit);
  Listed<TeamRow> listed = ListOf<TeamRow>(select, {}, TeamRowOf);
  const auto names = TextsByTeam(
      db_, "SELECT ifnull(t.merged_into, t.id), f.name FROM former_name AS f JOIN team AS t ON "
           "t.id = f.team_id UNION SELECT merged_into, name FROM team WHERE merged_into NOT NULL "
           "ORDER BY 2");
  const auto members = TextsByTeam(
      db_, absl::StrCat("SELECT m.team_id, m.person ", kMemberships, "ORDER BY m.person"));
  const auto of = [](const auto& texts, int64_t team) {
    const auto found = texts.find(team);
    return found == texts.end() ? std::vector<std::string>() : found->second;
  };
  for (TeamRow& team : listed.rows) {
    team.other_names = of(names, team.id);
    team.members = of(members, team.id);
  }
  return listed;
}

absl::StatusOr<TeamRow> Reader::Team(const std::string& name) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, name));
  SQLite::Statement select(db_, absl::StrCat(kTeamColumns, "WHERE t.id = ?"));
  select.bind(1, found.id);
  select.executeStep();
  TeamRow team;
  if (const StoredRow row = TeamRowOf(select, team); !row.ok()) return row.status();
  SQLite::Statement names(
      db_, absl::StrCat("SELECT name FROM former_name WHERE team_id IN ", RowsOfTeam(1),
                        " UNION SELECT name FROM team WHERE merged_into = ?1 ORDER BY 1"));
  names.bind(1, found.id);
  while (names.executeStep()) team.other_names.push_back(names.getColumn(0).getString());
  for (const MemberRow& member : Members(found.name).rows) team.members.push_back(member.person);
  return team;
}

Listed<MemberRow> Reader::Members(const std::string& team) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT m.id, m.person, m.at, m.who ", kMemberships,
                        "AND m.team_id IN ", RowsOfTeam(1), " ORDER BY m.person, m.id"));
  select.bind(1, KnownTeamId(db_, team));
  return ListOf<MemberRow>(select, {}, [](SQLite::Statement& read, MemberRow& member) {
    StoredRow row(read, "member", Shown(read.getColumn(0)));
    member.person = row.Text(1);
    member.since = row.Time(2);
    member.who = row.Text(3);
    return row;
  });
}

Listed<TeamEventRow> Reader::TeamEvents(const std::string& team) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT e.id, e.at, e.event, e.detail, e.who, e.why, e.team_id, t.name "
                        "FROM team_event AS e LEFT JOIN team AS t ON t.id = e.team_id "
                        "WHERE e.team_id IN ", RowsOfTeam(1), " ORDER BY e.id"));
  select.bind(1, KnownTeamId(db_, team));
  return ListOf<TeamEventRow>(select, {}, TeamEventOf);
}

int64_t Reader::SubmissionsOf(const std::string& team) {
  SQLite::Statement select(db_, absl::StrCat("SELECT count(*) FROM submission WHERE team_id IN ",
                                             RowsOfTeam(1)));
  select.bind(1, KnownTeamId(db_, team));
  select.executeStep();
  return select.getColumn(0).getInt64();
}

}  // namespace myograde::server
