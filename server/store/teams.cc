#include "server/store/teams.h"

#include <utility>

#include <absl/strings/cord.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/error_code.h"
#include "server/base/names.h"
#include "server/store/connection.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr char kResembledKey[] = "myograde/resembled-team";

int64_t RowNamedExactly(SQLite::Database& db, const std::string& name) {
  return FirstValue<int64_t>(db, "SELECT team_id FROM team_name WHERE name = ?", name);
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

// The row of the team that has or had the name, which may have been merged into another; 0: none.
int64_t TeamRowNamed(SQLite::Database& db, const std::string& name) {
  // As given first: an old team may have a name that is rejected today.
  if (const int64_t row = RowNamedExactly(db, name); row != 0) return row;
  const absl::StatusOr<std::string> clean = CleanName(name, "the team's name");
  return clean.ok() ? RowNamedExactly(db, *clean) : 0;
}

// The team that a row stands for. A damaged row if it is unreadable. REQUIRES: the row exists.
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

// Whether the team of the row 0 (a new team), or another one, may take a clean name, which no team
// has; errors as of Teams::Allowed.
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

// Adds one more name of a team, and what it looks like.
void AddName(SQLite::Database& db, int64_t team, const std::string& name) {
  Run(db, "INSERT OR IGNORE INTO team_name VALUES (?, ?)", name, team);
  for (const std::string& look : ConfusableSkeletons(name)) {
    Run(db, "INSERT OR IGNORE INTO team_skeleton VALUES (?, ?)", look, team);
  }
}

// Adds an act to the journal; `detail`: as of TeamEventRow. Its name is that of the row now.
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

// Memberships in force: the newest row of each team and person.
constexpr char kMemberships[] =
    "FROM member AS m WHERE m.id = (SELECT max(id) FROM member WHERE team_id IS m.team_id AND "
    "person IS m.person) AND m.belongs = 1 ";

absl::Status Conflict(const std::string& sentence) {
  return absl::FailedPreconditionError(sentence);
}

bool Belongs(SQLite::Database& db, int64_t team, const std::string& person) {
  return AnyRow(db, absl::StrCat("SELECT 1 ", kMemberships, "AND m.team_id = ? AND m.person = ?"),
                team, person);
}

void AddMember(SQLite::Database& db, int64_t now_ms, int64_t team, const std::string& person,
               bool belongs, const std::string& who) {
  Run(db, R"(INSERT INTO member (at, team_id, person, belongs, who) VALUES (?, ?, ?, ?, ?))",
      now_ms, team, person, belongs, who);
}

// Uploads that nobody has submitted count by the name of their team.
void RenameUploads(SQLite::Database& db, const std::string& from, const std::string& to) {
  Run(db, "UPDATE upload SET team = ? WHERE team = ?", to, from);
}

// FailedPreconditionError if a team of the row 0 (a new one), or another one, can't have the name.
absl::Status CheckFree(SQLite::Database& db, const std::string& clean, int64_t team) {
  const int64_t row = TeamRowNamed(db, clean);
  if (row == 0) return CheckNotConfusable(db, clean, team);
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
absl::StatusOr<std::pair<TeamInForce, TeamInForce>> Mergeable(SQLite::Database& db,
                                                              const std::string& team,
                                                              const std::string& into) {
  ASSIGN_OR_RETURN(const TeamInForce from, Unmerged(db, team));
  ASSIGN_OR_RETURN(const TeamInForce to, Unmerged(db, into));
  if (from.id == to.id) {
    return Conflict(absl::StrCat("team \"", from.name, "\" can't be merged into itself"));
  }
  for (const TeamInForce& one : {from, to}) {
    if (!one.banned) continue;
    return Conflict(absl::StrCat("team \"", one.name,
                                 "\" is banned, and a merge would hide that; "
                                 "unban it first"));
  }
  return std::pair(from, to);
}

std::vector<std::string> ListMembers(SQLite::Database& db, int64_t team) {
  return AllValues<std::string>(
      db, absl::StrCat("SELECT m.person ", kMemberships, "AND m.team_id = ? ORDER BY m.person"),
      team);
}

constexpr StoredRows<TeamRow, 8> kTeams = {"team", R"(SELECT t.id, t.name, t.created_at, t.banned,
    iif(t.merged_into IS NULL, '', g.name) AS merged_into, (SELECT count(*) FROM submission
    WHERE team_id IN (SELECT id FROM team WHERE id = ifnull(t.merged_into, t.id)
    OR merged_into = ifnull(t.merged_into, t.id))),
    (SELECT json_group_array(name) FROM (SELECT n.name FROM team_name AS n JOIN team AS o
    ON o.id = n.team_id WHERE t.merged_into IS NULL AND (o.id = t.id OR o.merged_into = t.id)
    AND n.name != t.name AND typeof(n.name) = 'text' ORDER BY n.name)),
    (SELECT json_group_array(person) FROM (SELECT m.person FROM member AS m WHERE m.team_id = t.id
    AND m.belongs = 1 AND typeof(m.person) = 'text' AND m.id = (SELECT max(id) FROM member
    WHERE team_id IS m.team_id AND person IS m.person) ORDER BY m.person))
    FROM team AS t LEFT JOIN team AS g ON g.id = t.merged_into )"};

constexpr StoredRows<MemberRow, 3> kMembers = {
    .table = "member", .select = "SELECT m.id, m.person, m.at, m.who ", .first = 1};

}  // namespace

std::string RowsOfTeam(int place) {
  return absl::StrCat("(SELECT id FROM team WHERE id = ?", place, " OR merged_into = ?", place,
                      ")");
}

std::string ResembledTeam(const absl::Status& status) {
  return std::string(status.GetPayload(kResembledKey).value_or(absl::Cord()));
}

void FillTeamSkeletons(SQLite::Database& db) {
  const std::string version = SkeletonVersion();
  const bool fits = Meta(db, "team_skeletons") == version;
  if (!fits) db.exec("DELETE FROM team_skeleton");
  Statement select(db, R"(SELECT n.team_id, n.name FROM team_name AS n JOIN team AS t
      ON t.id = n.team_id WHERE t.id NOT IN (SELECT team FROM team_skeleton))");
  std::vector<std::pair<int64_t, std::string>> teams;
  while (select.executeStep()) {
    teams.emplace_back(select.getColumn(0).getInt64(), select.getColumn(1).getString());
  }
  for (const auto& [team, name] : teams) AddName(db, team, name);
  if (!fits) SetMeta(db, "team_skeletons", version);
}

absl::StatusOr<TeamInForce> Teams::Allowed(const std::string& name) const {
  absl::StatusOr<TeamInForce> team = Named(name);
  if (!absl::IsNotFound(team.status())) return team;
  ASSIGN_OR_RETURN(std::string clean, CleanName(name, "the team's name"));
  RETURN_IF_ERROR(CheckNotConfusable(db_, clean, 0));
  return TeamInForce{.name = std::move(clean)};
}

absl::Status Teams::CheckNotBanned(const TeamInForce& team) const {
  if (!team.banned) return absl::OkStatus();
  std::string why;
  for (const TeamEventRow& event : Board().TeamEvents(team.id)) {
    if (event.event == "banned") why = event.why;
  }
  return CodedRefusal(
      kBannedCode,
      absl::StrCat("team \"", team.name, "\" is banned by the organisers",
                   why.empty() ? "" : absl::StrCat(" (", why, ")"),
                   ": nothing more is taken from it; what it has submitted stays readable for it"));
}

absl::StatusOr<TeamInForce> Teams::Named(const std::string& name) const {
  return FindTeam(db_, name);
}

int64_t Teams::IdOf(const std::string& name) const {
  const absl::StatusOr<TeamInForce> team = Named(name);
  return team.ok() ? team->id : 0;
}

std::string Teams::NameOf(const std::string& name) const {
  const absl::StatusOr<TeamInForce> team = Named(name);
  return team.ok() ? team->name : name;
}

int64_t Teams::Ensure(const TeamInForce& allowed, const std::string& who, const std::string& why) {
  if (allowed.id != 0) return allowed.id;
  Run(db_, "INSERT INTO team (name, created_at) VALUES (?, ?)", allowed.name, now_ms_);
  const int64_t team = db_.getLastInsertRowid();
  AddName(db_, team, allowed.name);
  AddTeamEvent(db_, now_ms_, team, "created", "", who, why);
  return team;
}

absl::Status Teams::Create(const std::string& team, const std::string& who,
                           const std::string& why) {
  ASSIGN_OR_RETURN(const std::string clean, CleanName(team, "the team's name"));
  RETURN_IF_ERROR(CheckFree(db_, clean, 0));
  Ensure({.name = clean}, who, why);
  return absl::OkStatus();
}

absl::Status Teams::Found(const std::string& team, const std::string& person, int64_t most) {
  ASSIGN_OR_RETURN(const TeamInForce found, Allowed(team));
  const std::string& name = found.name;
  std::set<std::string> teams = OfPerson(person);
  if (teams.contains(name)) return absl::OkStatus();
  // Also of teams that were merged into it, and those who were removed; a team may also be of
  // people with tokens, or of somebody for whom an organiser submits.
  const std::string rows = RowsOfTeam(1);
  if (AnyRow(db_,
             absl::StrCat("SELECT 1 FROM member WHERE team_id IN ", rows,
                          " UNION ALL SELECT 1 FROM token WHERE team_id IN ", rows,
                          " UNION ALL SELECT 1 FROM submission WHERE team_id IN ", rows,
                          " AND accepted_by != ?2 LIMIT 1"),
             found.id, person)) {
    return CodedRefusal(
        kForbiddenCode,
        absl::StrCat("team \"", name, "\" belongs to others, and ", person,
                     " is not a member of it; choose another name, or ask an organiser to add you"));
  }
  if (std::ssize(teams) >= most) {
    return CodedRefusal(
        kForbiddenCode,
        absl::StrCat(person, " belongs to ", TeamList(teams), ", and one person may belong to ",
                     Counted(most, "team"), "; go on with ",
                     teams.size() == 1 ? "that one" : "one of those", ", or ask an organiser"));
  }
  AddMember(db_, now_ms_, Ensure(found, person), person, true, person);
  return absl::OkStatus();
}

absl::StatusOr<bool> Teams::Rename(const std::string& team, const std::string& name,
                                   const std::string& who, const std::string& why) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  ASSIGN_OR_RETURN(const std::string clean, CleanName(name, "the team's new name"));
  if (clean == found.name) return false;
  RETURN_IF_ERROR(CheckFree(db_, clean, found.id));
  Run(db_, "UPDATE team SET name = ? WHERE id = ?", clean, found.id);
  AddName(db_, found.id, clean);
  RenameUploads(db_, found.name, clean);
  AddTeamEvent(db_, now_ms_, found.id, "renamed", found.name, who, why);
  return true;
}

absl::StatusOr<bool> Teams::SetMember(const std::string& team, const std::string& person,
                                      bool belongs, const std::string& who) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  if (Belongs(db_, found.id, person) == belongs) return false;
  AddMember(db_, now_ms_, found.id, person, belongs, who);
  return true;
}

absl::Status Teams::Merge(const std::string& team, const std::string& into, const std::string& who,
                          const std::string& why) {
  ASSIGN_OR_RETURN(const auto pair, Mergeable(db_, team, into));
  const auto& [from, to] = pair;
  // Teams that were merged into the first follow it, so that no row leads to another merged one.
  Run(db_, "UPDATE team SET merged_into = ?1 WHERE id = ?2 OR merged_into = ?2", to.id, from.id);
  for (const std::string& person : ListMembers(db_, from.id)) {
    AddMember(db_, now_ms_, from.id, person, false, who);
    if (!Belongs(db_, to.id, person)) AddMember(db_, now_ms_, to.id, person, true, who);
  }
  RenameUploads(db_, from.name, to.name);
  AddTeamEvent(db_, now_ms_, from.id, "merged", to.name, who, why);
  return absl::OkStatus();
}

absl::StatusOr<bool> Teams::Ban(const std::string& team, bool banned, const std::string& who,
                                const std::string& why) {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, team));
  if (found.banned == banned) return false;
  Run(db_, "UPDATE team SET banned = ? WHERE id = ?", banned, found.id);
  AddTeamEvent(db_, now_ms_, found.id, banned ? "banned" : "unbanned", "", who, why);
  return true;
}

absl::Status Teams::CheckMerge(const std::string& team, const std::string& into) const {
  return Mergeable(db_, team, into).status();
}

std::set<std::string> Teams::OfPerson(const std::string& person) const {
  std::set<std::string> teams;
  for (const int64_t row : AllValues<int64_t>(
           db_, absl::StrCat("SELECT m.team_id ", kMemberships, "AND m.person = ?"), person)) {
    const absl::StatusOr<TeamInForce> team = TeamOfRow(db_, row);
    if (team.ok()) teams.insert(team->name);
  }
  return teams;
}

Listed<TeamRow> Teams::List(int64_t before, int64_t limit) const {
  return kTeams.List(db_, "WHERE t.id < ? ORDER BY t.id DESC LIMIT ?", before, limit);
}

absl::StatusOr<TeamRow> Teams::Find(const std::string& name) const {
  ASSIGN_OR_RETURN(const TeamInForce found, FindTeam(db_, name));
  return kTeams.First(db_, NoSuch("team", found.id), "WHERE t.id = ?", found.id);
}

Listed<MemberRow> Teams::Members(const std::string& team) const {
  return kMembers.List(db_,
                       absl::StrCat(kMemberships, "AND m.team_id IN ", RowsOfTeam(1),
                                    " ORDER BY m.person, m.id"),
                       IdOf(team));
}

std::vector<TeamEventRow> Teams::Events(const std::string& team) const {
  return Board().TeamEvents(IdOf(team));
}

absl::Status Teams::Check(const std::string& team) const {
  ASSIGN_OR_RETURN(const TeamInForce allowed, Allowed(team));
  return CheckNotBanned(allowed);
}

}  // namespace myograde::server
