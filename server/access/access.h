// Who may do what: the one place that decides it. A request has an identity (who asks), an action
// (each address of the API has one) and, where it is about somebody's things, the team whose they
// are. server/api/README.md shows the same as a table.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

// Each role may do what those before it may.
enum class Role { kPublic, kParticipant, kOrganiser, kOperator };
std::string_view RoleName(Role role);
std::optional<Role> ParseRole(std::string_view name);

// One entry of server.json's access.users. Exactly one of uid, user, gid and group is given; user
// and group are names, which ResolveNames (server/config) turns into ids.
struct UserRule {
  std::optional<uid_t> uid;
  std::optional<gid_t> gid;
  std::string user;
  std::string group;
  Role role = Role::kParticipant;
  std::string team;  // of participants; "": none of its own
};

struct AccessConfig {
  std::vector<UserRule> users;
  int64_t teams_of_a_user = 1;  // that one user of this host may found, without a challenge
};

// Who asks. `key` is what limits count by and what rows record: "uid 1000", "token 7",
// "address 192.0.2.1".
struct Identity {
  Role role = Role::kPublic;
  std::string key;
  std::set<std::string> teams;  // of a participant
  bool remote = false;          // came over the network
  int64_t token = 0;            // that they showed; 0: none
  // Without a challenge, a user of this host may submit for a team that nobody has yet, and so
  // becomes its member.
  bool may_found_team = false;
  // Showed the token of server.json's "metrics", which is good for nothing but those.
  bool scraper = false;
};

enum class Action {
  // Everybody.
  kReadHealth, kReadTracks, kReadBoard, kReadChallenge, kReadKey, kReadRecord, kReadApi,
  // Participants, of their own teams.
  kUpload, kSubmit, kReadSubmission, kCancel, kRerun, kReadReceipt, kReadLog, kReadQuota, kChoose,
  kReadTeam,
  // Organisers.
  kMark, kGrant, kRebuildBoards, kExport, kManageTeams, kManageTokens, kManagePhases, kRejudge,
  kReadEvents, kReadHost, kReadMetrics,
  // Operators.
  kImport, kBackup, kManageOperators, kManageWebhooks, kManageNodes,
};
std::string_view ActionName(Action action);

// The least role that an action needs.
Role RoleFor(Action action);
// Whether a participant may take the action for own teams only.
bool NeedsTeam(Action action);

// Whether the action may be taken. `team`: whose things it is about, if NeedsTeam(action); nullopt
// before that is known, which decides by the role alone. What is another team's is answered exactly
// as if it did not exist.
bool MayTake(const Identity& identity, Action action, const std::optional<std::string>& team);

}  // namespace myograde::server
