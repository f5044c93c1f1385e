// Team names in the store. Internal to it; everything here throws SQLite::Exception.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/board/board_state.h"

namespace myograde::server {

// The row of the team that has or had the name, which may have been merged into another; 0: none.
int64_t TeamRowNamed(SQLite::Database& db, const std::string& name);

// The team that a row stands for: itself, or what it was merged into.
struct TeamInForce {
  int64_t id = 0;
  std::string name;
  bool banned = false;
};
// A damaged row if it is unreadable. REQUIRES: the row exists.
absl::StatusOr<TeamInForce> TeamOfRow(SQLite::Database& db, int64_t row);
// NotFoundError: no team has or had this name.
absl::StatusOr<TeamInForce> FindTeam(SQLite::Database& db, const std::string& name);

// Its id; 0: none.
int64_t KnownTeamId(SQLite::Database& db, const std::string& name);

// For a condition `team_id IN (...)`: a team with those merged into it. `place` is the number of
// the parameter with the team's id.
std::string RowsOfTeam(int place);

// The stored name of the team called `name`: an existing team's name as it is today, else the clean
// form (CleanName) that a new team would get.
//   InvalidArgumentError      no such team, and the name is not allowed
//   FailedPreconditionError   code "look_alike": no such team, and the name looks like another's,
//                             which ResembledTeam returns
absl::StatusOr<std::string> TeamNamed(SQLite::Database& db, const std::string& name);
// Whether the team of the row 0 (a new team), or another one, may take a clean name, which no team
// has; errors as of TeamNamed.
absl::Status CheckNotConfusable(SQLite::Database& db, const std::string& clean, int64_t team);

// FailedPreconditionError with the code "banned" if the team called `name` is banned.
absl::Status CheckNotBanned(SQLite::Database& db, const BoardState& board, const std::string& name);

// For queries, which need not reject new names: an existing team's name, else `name`.
std::string KnownTeam(SQLite::Database& db, const std::string& name);

// REQUIRES: `name` came from TeamNamed. Returns the team's id; it is created if it does not exist.
int64_t AddTeam(SQLite::Database& db, const std::string& name, int64_t now_ms,
                const std::string& who, const std::string& why = "");
// Adds an act to the journal; `detail`: as of TeamEventRow. Its name is that of the row now.
void AddTeamEvent(SQLite::Database& db, int64_t now_ms, int64_t team, const std::string& event,
                  const std::string& detail, const std::string& who, const std::string& why);
// Adds the looks of one more name of a team.
void AddSkeletons(SQLite::Database& db, int64_t team, const std::string& name);

// Computes the looks of teams that have none, or of all if the rule has changed.
void FillTeamSkeletons(SQLite::Database& db);

}  // namespace myograde::server
