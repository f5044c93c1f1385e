// A board and its statistics as the API returns them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/statistics_config.h"
#include "scoring/track.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/views.h"
#include "server/grading/leaderboard.h"
#include "server/store/store.h"

namespace myograde::server {

// Which build of the grader the rows of a board were played by.
struct BoardBuilds {
  struct Count {
    std::string build;
    size_t rows = 0;
  };
  std::vector<std::string> of_rows;
  // The board's own first, which most rows are of; of equally many, the one of the newest
  // evaluation.
  std::vector<Count> counts;

  // "": the board is empty.
  std::string own() const { return counts.empty() ? "" : counts.front().build; }
};

// Of rows whose evaluations have these ids and builds.
BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders);

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
