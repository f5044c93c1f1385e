// Results and findings as text, from the JSON of the API or of a local run.
#pragma once

#include <string>
#include <vector>

#include "server/cli/terminal/text.h"

namespace myograde::server {

// Aggregate, outcomes, what the policy printed last, and hashes, their first digits unless
// `full_hashes`. `result` has the keys of an evaluation in server/api/README.md.
void PrintResult(const Json& result, bool full_hashes);

// A column for each of the API's `metrics` (name, title, unit, digits), of objects with their
// values.
std::vector<RowColumn> MetricColumns(const Json& metrics);

// One line for each episode of the array `rows`, then the faults in words. `metrics` are those of
// the result.
void PrintEpisodes(const Json& rows, const Json& metrics, bool full_hashes);

// Why episodes of the array `rows` ended by a fault, in words.
void PrintFaults(const Json& rows);

// What a re-run found, episode by episode.
void PrintComparison(const Json& comparison);

// What the API could not show (`unreadable` of `answer`), one line each.
void PrintUnreadable(const Json& answer);

// The rows of `answer` at `key` as a table, or the sentence `none` if there are none; then what
// could not be shown.
void PrintList(const Json& answer, const std::string& key, const std::string& none,
               const std::vector<RowColumn>& columns);

// "31/100 episodes, 4 successes" of the counts in `episodes` of a submission.
std::string CountsText(const Json& submission);

enum class FindingState {
  kOk,
  kWarning,  // it would be accepted, and is worth a look
  kUnknown,  // it could not be checked here
  kFails,
};

// What a check found, in words: for verbs that report everything at once rather than end at the first
// mistake.
struct Finding {
  std::string check;  // one word
  FindingState state = FindingState::kOk;
  std::string found;      // a sentence without a full stop
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
