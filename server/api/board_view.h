// A board as the API returns it.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/board_query.h"
#include "server/grading/leaderboard.h"
#include "server/store/reader.h"

namespace myograde::server {

// A row, without what it is only beside others.
nlohmann::json RowToJson(const LeaderboardRow& row);

absl::StatusOr<nlohmann::json> BoardView(Reader& reader, const BoardQuery& asked);

}  // namespace myograde::server
