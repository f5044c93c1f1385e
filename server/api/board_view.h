// A board and its statistics as the API returns them.
#pragma once

#include <absl/status/statusor.h>

#include "scoring/statistics_config.h"
#include "scoring/track.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/views.h"
#include "server/grading/leaderboard.h"
#include "server/store/store.h"

namespace myograde::server {

// The numbers that the board shows beside the successes.
Json ColumnsToJson(const scoring::ScoredTrack& track, const scoring::BoardSpec& board);

// `statistics`: of the board. If its ranks are those of groups, so are the rows' ranks. Errors of
// `kept`.
absl::StatusOr<Json> BoardView(const Transaction& reader, const BoardQuery& asked,
                               const scoring::StatisticsConfig& statistics, KeptStatistics& kept);

// The tests that tell the board's close places apart. Errors of `kept`.
absl::StatusOr<Json> StatisticsView(const Transaction& reader, const BoardQuery& asked,
                                    const scoring::StatisticsConfig& config, KeptStatistics& kept);

}  // namespace myograde::server
