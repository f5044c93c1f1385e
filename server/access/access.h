// Who may do what: the one place that decides it. A request has an identity (who asks), an action
// (each address of the API has one) and, where it is about somebody's things, the team whose they
// are. server/api/README.md shows the same as a table.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>

#include "server/access/role.h"

namespace myograde::server {

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
std::span<const Action> AllActions();

// The least role that an action needs.
Role RoleFor(Action action);
// Whether a participant may take the action for own teams only.
bool NeedsTeam(Action action);

enum class Access {
  kAllowed,
  kForbidden,  // the caller may know that it exists
  kUnknown,    // it is another team's: answered exactly as if it did not exist
};

// `team`: whose things the action is about, if NeedsTeam(action); nullopt before that is known, which
// decides by the role alone.
Access Decide(const Identity& identity, Action action, const std::optional<std::string>& team);

}  // namespace myograde::server
