// What a check found, in words: for verbs that report everything at once rather than end at the first
// mistake.
#pragma once

#include <string>
#include <vector>

#include "server/cli/terminal/text.h"

namespace myograde::server {

enum class FindingState {
  kOk,
  kWarning,  // it would be accepted, and is worth a look
  kUnknown,  // it could not be checked here
  kFails,
};

struct Finding {
  std::string check;  // one word
  FindingState state = FindingState::kOk;
  std::string found;  // a sentence without a full stop
  std::string todo = {};  // what to do about it; "" if nothing
};

// True if a finding of that state is among them.
bool HasFinding(const std::vector<Finding>& findings, FindingState state);

// The worst state of all, in the order of FindingState.
FindingState WorstOf(const std::vector<Finding>& findings);

// "ok", "warning", "unknown" or "fails".
const char* FindingStateName(FindingState state);

// An array of {"name", "state", "found", "todo"}.
Json FindingsJson(const std::vector<Finding>& findings);

// A table, then for each that is not ok what to do.
void PrintFindings(const std::vector<Finding>& findings);

}  // namespace myograde::server
