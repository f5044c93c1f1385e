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

// Teams and their members. Every name may also be a former one, or that of a team that was merged
// into the one meant. NotFoundError: there is no such team. "True" means that it changed anything.
class Teams : StorePart {
 public:
  using StorePart::StorePart;

  // Errors as of Submissions::Accept.
  absl::Status Check(const std::string& team) const;
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
  // FailedPreconditionError if there is such a team; otherwise the name errors of Accept.
  absl::Status Create(const std::string& team, const std::string& who, const std::string& why);
  // Makes `person` the first member of a team, which is created if there is none. Does nothing for
  // a member. FailedPreconditionError with the code "forbidden" if the team has or had other
  // members, tokens, or submissions of others, or if the person would belong to more than `most`
  // teams.
  absl::Status Found(const std::string& team, const std::string& person, int64_t most);
  // The old name still finds the team. FailedPreconditionError if the new one is or was another
  // team's; otherwise the name errors of Accept.
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
