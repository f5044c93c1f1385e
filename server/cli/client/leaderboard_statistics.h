// The statistics of a leaderboard, for people.
#pragma once

#include <nlohmann/json.hpp>

namespace myograde::server {

// The answer of GET /v1/leaderboard/statistics.
void PrintStatistics(const nlohmann::json& answer);

}  // namespace myograde::server
