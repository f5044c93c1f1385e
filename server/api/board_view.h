// A board as the API returns it.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "scoring/statistics_config.h"
#include "server/api/board_query.h"
#include "server/api/kept_statistics.h"
#include "server/grading/leaderboard.h"
#include "server/store/reader.h"

namespace myograde::server {

// A row, without what it is only beside others.
nlohmann::json RowToJson(const LeaderboardRow& row);

// Adds which board was asked for, and how much of it the caller sees. `withheld`: some was left out.
void AddBoardAsked(const BoardQuery& asked, bool withheld, nlohmann::json& json);

// `statistics`: of the board. If its ranks are those of groups, so are the rows' ranks. Errors of `kept`.
absl::StatusOr<nlohmann::json> BoardView(Reader& reader, const BoardQuery& asked,
                                         const scoring::StatisticsConfig& statistics,
                                         KeptStatistics& kept);

}  // namespace myograde::server
