// A store with two teams that share no row, and functions that write into it what a failing disk or
// a determined person could.
#pragma once

#include <string>
#include <vector>

#include "history_world.h"

namespace myograde::server {

// Each team has one finished evaluation and one played in part.
struct TwoTeams {
  struct Team {
    std::string config;
    std::string board;  // of its config, as text
    int64_t done = 0;
    int64_t open = 0;
    int64_t queued = 0;  // only for the other team
  };
  std::string store;  // the file
  Team victim;
  Team other;
};

// Creates the store in `folder`, which stays.
TwoTeams MakeTwoTeams(const std::string& folder);

// A config's board as text: rows, and what is unreadable.
std::string BoardText(ReaderPool& readers, const std::string& config);

// A column of a row that belongs to the victim or to nobody.
struct Target {
  std::string table;
  std::string where;  // of one row
  std::string column;
};
std::vector<Target> TargetsIn(const TwoTeams& teams);

// Writes `value`, an SQL expression, bypassing types, constraints and triggers. False if the file
// can't hold it there even so.
bool Overwrite(const std::string& store, const Target& target, const std::string& value);

}  // namespace myograde::server
