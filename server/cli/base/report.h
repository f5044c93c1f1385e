// Results and findings as text, from the JSON of the API or of a local run.
#pragma once

#include <initializer_list>
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

// What the API could not show (`unreadable` of `answer`), one line each.
void PrintUnreadable(const Json& answer);

// The rows of `answer` at `key` as a table, or the sentence `none` if there are none.
void PrintList(const Json& answer, const std::string& key, const std::string& none,
               const std::vector<RowColumn>& columns);

// Checks with "name", "state", "found" and "todo" as a table; then, state by state of `states`, those
// that have something to do: `before`, name and state, and `advice` as Filled (text.h) makes it.
void PrintChecks(const Json& checks, std::initializer_list<const char*> states, const char* before,
                 const char* advice);

// "31/100 episodes, 4 successes" of the counts in `episodes` of a submission.
std::string CountsText(const Json& submission);

}  // namespace myograde::server
