// The names of teams in the store. Internal to it; all of this throws SQLite::Exception.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "server/store/connection.h"

namespace myograde::server {

// The name under which the store has the team that is called `name`, or would have
// it: an existing team's as it is, else the clean form (CleanName).
//   InvalidArgumentError      there is no such team, and none may be called so
//   FailedPreconditionError   code "look_alike": there is none, and it looks like another;
//                             ResembledTeam has that one's name
absl::StatusOr<std::string> TeamNamed(SQLite::Database& db, const std::string& name);

// For questions, where no new name is to be refused: an existing team's, else `name`.
std::string KnownTeam(SQLite::Database& db, const std::string& name);

// REQUIRES: TeamNamed gave `name`. Does nothing if the team is there.
void AddTeam(SQLite::Database& db, const std::string& name, int64_t now_ms);

// Makes the looks of teams that have none, and of all if the rule has changed.
void FillTeamLooks(SQLite::Database& db);

}  // namespace myograde::server
