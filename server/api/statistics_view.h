// A board's statistics as the API returns them.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "server/api/board_statistics.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {

// "statistics", "rows", "groups" and "undecided" of the answer.
absl::StatusOr<nlohmann::json> StatisticsAnswer(Reader& reader, const Track& track,
                                                const scoring::BoardRules& rules,
                                                const Leaderboard& board,
                                                const BoardStatistics& statistics,
                                                const scoring::StatisticsConfig& config);

}  // namespace myograde::server
