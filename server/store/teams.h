// Teams and their members in the store.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

// The team that the name of a "look_alike" error resembles, for the organiser. "" for any other
// status.
std::string ResembledTeam(const absl::Status& status);

// The team that a name or a row stands for: itself, or what it was merged into.
struct TeamInForce {
  int64_t id = 0;
  std::string name;
  bool banned = false;
};

// For a condition `team_id IN (...)`: a team with those merged into it. `place` is the number of
// the parameter with the team's id. Internal to the store.
std::string RowsOfTeam(int place);

// Computes what the names of teams look like, where that is missing, or of all teams if the rule
// has changed. Internal to the store; throws SQLite::Exception.
void FillTeamSkeletons(SQLite::Database& db);

// Teams and their members. Every name may also be a former one, or that of a team that was merged
// into the one meant. NotFoundError: there is no such team. "True" means that it changed anything.
class Teams : StorePart {
 public:
  using StorePart::StorePart;

  // Whether a team may submit: errors of Allowed and CheckNotBanned.
  absl::Status Check(const std::string& team) const;
  // FailedPreconditionError with the code "banned" if it is.
  absl::Status CheckNotBanned(const TeamInForce& team) const;
  // The team called `name` or, with the id 0, one that there could be: by the clean form of the
  // name (CleanName).
  //   InvalidArgumentError      no such team, and the name is not allowed
  //   FailedPreconditionError   code "look_alike": no such team, and the name looks like another's,
  //                             which ResembledTeam returns
  absl::StatusOr<TeamInForce> Allowed(const std::string& name) const;
  // A damaged row (damage.h) if the team can't be read.
  absl::StatusOr<TeamInForce> Named(const std::string& name) const;
  // Its id; 0: there is none, or it can't be read.
  int64_t IdOf(const std::string& name) const;
  // The stored name of the team called `name`, now or formerly; `name` itself if there is none.
  std::string NameOf(const std::string& name) const;
  // The teams that a person belongs to: "uid 1000". An unreadable membership is none.
  std::set<std::string> OfPerson(const std::string& person) const;
  // The team called `name`, now or formerly: never one that was merged into another.
  absl::StatusOr<TeamRow> Find(const std::string& name) const;
  // Newest first, with those that were merged; `before` is an id.
  Listed<TeamRow> List(int64_t before = INT64_MAX, int64_t limit = INT64_MAX) const;
  // By person.
  Listed<MemberRow> Members(const std::string& team) const;
  // Oldest first, with those of the teams that were merged into it.
  std::vector<TeamEventRow> Events(const std::string& team) const;
  // Whether they can be merged; errors as of Teams::Merge.
  absl::Status CheckMerge(const std::string& team, const std::string& into) const;
  // Its id; one with the id 0 is created. REQUIRES: it came from Allowed, in the same change.
  int64_t Ensure(const TeamInForce& allowed, const std::string& who, const std::string& why = "");
  // FailedPreconditionError if there is such a team; otherwise errors of Allowed.
  absl::Status Create(const std::string& team, const std::string& who, const std::string& why);
  // Makes `person` the first member of a team, which is created if there is none. Does nothing for
  // a member. FailedPreconditionError with the code "forbidden" if the team has or had other
  // members, tokens, or submissions of others, or if the person would belong to more than `most`
  // teams.
  absl::Status Found(const std::string& team, const std::string& person, int64_t most);
  // The old name still finds the team. FailedPreconditionError if the new one is or was another
  // team's; otherwise errors of Allowed.
  absl::StatusOr<bool> Rename(const std::string& team, const std::string& name,
                              const std::string& who, const std::string& why);
  absl::StatusOr<bool> SetMember(const std::string& team, const std::string& person, bool belongs,
                                 const std::string& who);
  // From now on `team` is a part of `into`: its submissions, its ledger, its tokens and its members
  // are those of `into`. No row that tells what happened changes. Can't be undone.
  // FailedPreconditionError if both are one team, if either was merged before, or is banned.
  absl::Status Merge(const std::string& team, const std::string& into, const std::string& who,
                     const std::string& why);
  absl::StatusOr<bool> Ban(const std::string& team, bool banned, const std::string& who,
                           const std::string& why);
};

}  // namespace myograde::server
