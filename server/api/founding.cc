#include "server/api/founding.h"

#include <cstdint>

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
  std::optional<Founding> founding;
  const absl::Status status = context.readers.Read([&](Reader& reader) {
    if (!caller.may_found_team) return RequireTeam(reader, team);
    if (!caller.teams.contains(reader.TeamOf(team))) {
      founding = {caller.key, context.config.access.teams_of_a_user, /*needed=*/true};
    }
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return founding;
}

}  // namespace myograde::server
