// Results as text, from the JSON of the API or of a local run.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace myograde::server {

// Aggregate, outcomes, what the policy printed last, and hashes, their first digits unless
// `full_hashes`. `result` has the keys of an evaluation in server/api/README.md.
void PrintResult(const nlohmann::json& result, bool full_hashes);

// A metric as a column of a table, or a line of a result.
struct MetricColumn {
  std::string key;
  std::string title;  // with its unit
  int digits = 4;     // after the point
};

// Of what the API tells of metrics (name, title, unit, digits).
std::vector<MetricColumn> MetricColumns(const nlohmann::json& metrics);

// One line for each episode of the array `rows`, then the faults in words. `metrics` are those of
// the result.
void PrintEpisodes(const nlohmann::json& rows, const nlohmann::json& metrics, bool full_hashes);

// Why episodes of the array `rows` ended by a fault, in words.
void PrintFaults(const nlohmann::json& rows);

// What a re-run found, episode by episode.
void PrintComparison(const nlohmann::json& comparison);

// What the API could not show (`unreadable` of `answer`), one line each.
void PrintUnreadable(const nlohmann::json& answer);

// "31/100 episodes, 4 successes" of the counts of a submission.
std::string CountsText(const nlohmann::json& episodes);

}  // namespace myograde::server
