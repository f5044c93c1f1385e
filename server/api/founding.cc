#include "server/api/founding.h"

#include <cstdint>

#include <absl/strings/str_cat.h>

#include "server/api/caller.h"

namespace myograde::server {

absl::StatusOr<std::optional<Founding>> FoundingFor(const ApiContext& context,
                                                    const std::string& team) {
  const Identity& caller = Caller();
  if (CallerIsOrganiser()) {
    // Whoever submits for a new team is its first member, organisers too; they may also submit for
    // teams of others.
    if (!caller.may_found_team) return std::optional<Founding>();
    return std::optional(Founding{caller.key, INT64_MAX, /*needed=*/false});
  }
  std::string known = team;
  const absl::Status status = context.readers.Read([&](Reader& reader) {
    known = reader.TeamOf(team);
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  if (caller.may_found_team && !caller.teams.contains(known)) {
    return std::optional(
        Founding{caller.key, context.config.access.teams_of_a_user, /*needed=*/true});
  }
  const absl::Status allowed = Require(
      known, absl::NotFoundError(absl::StrCat("there is no team \"", team, "\" of yours")));
  if (!allowed.ok()) return allowed;
  return std::optional<Founding>();
}

}  // namespace myograde::server
