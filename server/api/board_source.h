// What may stand on a board.
#pragma once

#include <cstdint>
#include <vector>

#include <absl/status/statusor.h>

#include "server/grading/leaderboard.h"
#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

// Everything that may stand on a board, and what can't be read of it.
struct BoardSource {
  std::vector<StandingRow> standings;
  Marks marks;
  std::vector<Damage> damaged;
  bool withheld = false;  // some were left out
};

// `before_ms`: what ended from then on is left out.
absl::StatusOr<BoardSource> SourceOf(Reader& reader, const Track& track, int64_t before_ms);

}  // namespace myograde::server
