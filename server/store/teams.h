// Team names in the store. Internal to it; everything here throws SQLite::Exception.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "server/store/connection.h"

namespace myograde::server {

// The stored name of the team called `name`: an existing team's name as it is, else the clean form
// (CleanName) that a new team would get.
//   InvalidArgumentError      no such team, and the name is not allowed
//   FailedPreconditionError   code "look_alike": no such team, and the name looks like another's,
//                             which ResembledTeam returns
absl::StatusOr<std::string> TeamNamed(SQLite::Database& db, const std::string& name);

// For queries, which need not reject new names: an existing team's name, else `name`.
std::string KnownTeam(SQLite::Database& db, const std::string& name);

// REQUIRES: `name` came from TeamNamed. Does nothing if the team exists.
void AddTeam(SQLite::Database& db, const std::string& name, int64_t now_ms);

// Computes the looks of teams that have none, or of all if the rule has changed.
void FillTeamLooks(SQLite::Database& db);

}  // namespace myograde::server
