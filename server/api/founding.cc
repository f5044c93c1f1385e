#include "server/api/founding.h"

#include <algorithm>
#include <cstdint>

#include <absl/strings/str_cat.h>

#include "server/api/caller.h"
#include "server/base/names.h"
#include "server/store/quota.h"

namespace myograde::server {
namespace {

// The name that a team has, or will have once there is one: all forms of a name are one team.
std::string NameOf(Reader& reader, const std::string& team) {
  const std::string known = reader.TeamOf(team);
  return CleanName(known, "the team's name").value_or(known);
}

// Whether the settings give the team to somebody, who need not have submitted anything yet.
bool IsGiven(Reader& reader, const AccessConfig& access, const std::string& team) {
  return std::any_of(access.users.begin(), access.users.end(), [&](const UserRule& rule) {
    return !rule.team.empty() && NameOf(reader, rule.team) == team;
  });
}

absl::Status BelongsToOthers(const std::string& team) {
  NoteDenial("another team's");
  return WithErrorCode(
      absl::FailedPreconditionError(absl::StrCat(
          "team \"", team, "\" belongs to others; choose another name, or ask an organiser to add "
          "you")),
      kForbiddenCode);
}

}  // namespace

absl::StatusOr<std::optional<Founding>> FoundingFor(const ApiContext& context,
                                                    const std::string& team) {
  const Identity& caller = Caller();
  if (CallerIsOrganiser()) {
    // Whoever submits for a new team is its first member, organisers too; they may also submit for
    // teams of others.
    if (!caller.may_found_team) return std::optional<Founding>();
    return std::optional(Founding{caller.key, INT64_MAX, /*needed=*/false});
  }
  std::optional<Founding> founding;
  const absl::Status status = context.readers.Read([&](Reader& reader) {
    if (!caller.may_found_team) return RequireTeam(reader, team);
    const std::string known = reader.TeamOf(team);
    if (!caller.teams.contains(known)) {
      if (IsGiven(reader, context.config.access, NameOf(reader, team))) return BelongsToOthers(known);
      founding = {caller.key, context.config.access.teams_of_a_user, /*needed=*/true};
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return founding;
}

}  // namespace myograde::server
