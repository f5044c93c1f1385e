// The `statistics` section of server.json and of a phase: how boards tell close places apart.
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/groups.h"

namespace myograde::scoring {

struct StatisticsConfig {
  // What stands in "rank": the place by the board's rules, or for every row of a group that of the
  // group's first row.
  enum class Ranks { kRules, kGroups };

  GroupRules groups;
  Ranks ranks = Ranks::kRules;

  bool operator==(const StatisticsConfig&) const = default;
};

// Every key is optional and `fallback` where it is missing. InvalidArgumentError names `where` and the
// key; so it does if the samples are too few for any test to decide (FewestSamples).
absl::StatusOr<StatisticsConfig> ParseStatistics(const nlohmann::json& json,
                                                 const std::string& where,
                                                 const StatisticsConfig& fallback);

// As the file says it.
nlohmann::json StatisticsToJson(const StatisticsConfig& config);

}  // namespace myograde::scoring
