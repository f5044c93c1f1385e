// What may stand on a board, and the board that it makes.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/api/context.h"
#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"
#include "server/grading/tracks.h"
#include "server/store/reader_pool.h"

namespace myograde::server {

// Everything that may stand on a board, and what can't be read of it.
struct BoardSource {
  std::vector<StandingRow> standings;
  Marks marks;
  std::vector<Damage> damaged;
  bool withheld = false;  // a freeze left some out
};

// Of the config of `track`, as of a moment.
absl::StatusOr<BoardSource> SourceOf(const Transaction& reader, const Track& track,
                                     const BoardMoment& moment);

// The ranked board that it makes, with all that can't be read.
absl::StatusOr<Leaderboard> BoardOf(const BoardSource& source, const Track& track,
                                    const scoring::BoardRules& rules);

// The ranked board `board` ("main") under the config of `track`, as of a moment, or with a rejudge
// taken as applied. What can't be read is in `damaged`. InvalidArgumentError: it has no such board.
//
//   // The board as it is, and as it would be with rejudge 3:
//   BoardUnder(reader, *old_track, "main", {});
//   BoardUnder(reader, *new_track, "main", {.assumed_rejudge = 3});
absl::StatusOr<Leaderboard> BoardUnder(const Transaction& reader, const Track& track,
                                       const std::string& board, const BoardMoment& moment);

// What the board of `live` had at a moment; `live` is what the daemon plays there now, or played
// last. A damaged row (store/damage.h) if that can't be read any more.
absl::StatusOr<TrackPtr> TrackAt(const Transaction& reader, const TrackPtr& live,
                                 int64_t before_ms);

// Computes from the episodes what boards are ranked by, and writes it: anew, or only what the
// store's view lacks. The result is what was written, and what could not be read.
absl::StatusOr<Standings> RewriteStandings(const ApiContext& context, bool missing_only);

}  // namespace myograde::server
