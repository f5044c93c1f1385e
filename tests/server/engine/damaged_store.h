// A store with two teams that share no row, and an editor who writes into it whatever a disk or a
// determined person could.
#pragma once

#include <string>
#include <vector>

#include "history_world.h"

namespace myograde::server {

// Of each team one evaluation is done and one has played a part.
struct TwoTeams {
  struct Team {
    std::string config;
    std::string board;  // of its config, as text
    int64_t done = 0;
    int64_t open = 0;
    int64_t queued = 0;  // the other team's alone
  };
  std::string store;  // the file
  Team victim;
  Team other;
};

// Made in `folder`, which stays.
TwoTeams MakeTwoTeams(const std::string& folder);

// The board of a config as text: rows, and what can't be read.
std::string BoardText(ReaderPool& readers, const std::string& config);

// A column of a row of the victim's, or of nobody's.
struct Target {
  std::string table;
  std::string where;  // of one row
  std::string column;
};
std::vector<Target> TargetsIn(const TwoTeams& teams);

// Writes `value`, an SQL expression, past types, constraints and triggers. False if even so the
// file can't hold it there.
bool Overwrite(const std::string& store, const Target& target, const std::string& value);

}  // namespace myograde::server
