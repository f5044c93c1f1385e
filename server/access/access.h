// Who may do what: the one place that decides it. A request has an identity (who asks), an action
// (each address of the API has one) and, where it is about somebody's things, the team whose they
// are. GET /v1/addresses and the OpenAPI document say the same. And what a participant may see of an
// evaluation, of which a phase of a challenge may withhold parts (server/api/redaction.h). Pure.
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
  kReadHealth, kReadTracks, kReadBoard, kReadReplay, kReadChallenge, kReadKey, kReadRecord, kReadApi,
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

// What a phase shows to a team of its own evaluations. Organisers see everything.
struct Visibility {
  bool aggregate = true;   // the means that the board ranks by
  bool outcomes = true;    // outcome and reason of each episode
  bool metrics = true;     // metrics, steps and digests of each episode
  bool logs = true;        // facts, details and log of each episode
  bool output = true;      // what the policy printed, and the text of its faults
  bool seeds = true;       // false as long as committed seeds are not revealed
  bool progress = true;    // what goes on inside a lease, and the single episodes of an evaluation that
                           // is not done: false while anything above is withheld and the phase is not
                           // published, as nothing may be charged for them

  bool operator==(const Visibility&) const = default;
};

// What is known of the phase that an evaluation belongs to. The default is that of evaluations
// outside of all phases: nothing is withheld.
struct PhaseVisibility {
  Visibility shown = {};   // while it is not published, as its file says; `seeds` is ignored
  bool published = false;
  bool committed = false;  // its seeds are hidden until they are revealed
  bool revealed = false;   // which publishes it, too
};

// A phase that no file describes any more: until it is published, its teams see the aggregate and
// nothing else.
inline constexpr Visibility kUnknownPhaseVisibility = {.aggregate = true,
                                                    .outcomes = false,
                                                    .metrics = false,
                                                    .logs = false,
                                                    .output = false,
                                                    .seeds = false,
                                                    .progress = false};

Visibility ComputeVisibility(Role role, const PhaseVisibility& phase);

// Whether nothing is withheld.
inline bool SeesAll(const Visibility& visibility) { return visibility == Visibility{}; }
// Whether the file of a log may be read: it holds its episode's seed.
inline bool SeesLogs(const Visibility& visibility) { return visibility.logs && visibility.seeds; }
// Whether a receipt may be read: it lists outcome and metrics of each episode.
inline bool SeesReceipt(const Visibility& visibility) { return visibility.outcomes && visibility.metrics; }

// Whether everybody may watch the best episode of a board's leader. `allowed`: the organiser says so.
bool IsReplayPublic(bool allowed, const PhaseVisibility& phase);

// The names of what is withheld, as a challenge file's "show" calls them, and "seeds".
std::vector<std::string_view> WithheldParts(const Visibility& visibility);

}  // namespace myograde::server
