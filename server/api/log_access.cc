#include "server/api/log_access.h"

#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/api/phase_sight.h"

namespace myograde::server {
namespace {

// Two teams have the same log if they handed in the same policy.
absl::Status RequireLog(Reader& reader, const std::string& hash) {
  const std::set<std::string> teams = reader.TeamsOfLog(hash);
  if (teams.empty()) return MissingLog(hash);
  for (const std::string& team : teams) {
    if (Caller().teams.contains(team)) return Require(team, MissingLog(hash));
  }
  return Require(*teams.begin(), MissingLog(hash));
}

// A log holds its episode's seed. Equal logs are of one phase, as they hold their config.
absl::Status CheckLogShown(Reader& reader, const ApiContext& context, const std::string& hash) {
  for (const std::string& phase : reader.PhasesOfLog(hash)) {
    ASSIGN_OR_RETURN(const Visibility sight, SightOfPhase(reader, context, phase));
    if (SeesLogs(sight)) continue;
    return WithheldError(absl::StrCat("phase \"", phase, "\" withholds the logs of its episodes"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status MissingLog(const std::string& hash) {
  return absl::NotFoundError(
      absl::StrCat("there is no log ", hash, " here; it was never kept, or was removed"));
}

absl::Status RequireShownLog(const ApiContext& context, const std::string& hash) {
  if (CallerIsOrganiser()) return absl::OkStatus();
  return context.readers.Read([&](Reader& reader) {
    const absl::Status own = RequireLog(reader, hash);
    return own.ok() ? CheckLogShown(reader, context, hash) : own;
  });
}

}  // namespace myograde::server
