// Which board a request asks for, what may stand on it, and the board that it makes.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "scoring/track.h"
#include "server/api/context.h"
#include "server/board/acts.h"
#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"
#include "server/grading/tracks.h"
#include "server/http/request.h"
#include "server/store/store.h"

namespace myograde::server {

// The track and board that a request names.
struct BoardQuery {
  TrackPtr track;  // in the config that is asked for
  std::string board;
  const scoring::BoardSpec* rules = nullptr;  // the track's
  std::string config_in_force = "";  // the hash of what the board has, or had at that moment
  int64_t at_ms = 0;                 // the moment that is asked for; 0: now
  // When its phase freezes it, as long as that has not been undone.
  absl::Time freezes = absl::InfiniteFuture();
  bool frozen = false;  // by the calendar, at the moment that is asked for
  bool whole = true;    // the caller sees all of it

  // The moment itself counts. However the calendar is set, a row that is as late as the freeze
  // stays hidden.
  BoardMoment moment() const {
    return {.before_ms = at_ms == 0 ? INT64_MAX : at_ms + 1,
            .freeze_ms = whole ? INT64_MAX : absl::ToUnixMillis(freezes)};
  }
  // Boards of one config that look different.
  int view() const { return (frozen ? 2 : 0) + (whole ? 1 : 0); }
  BoardName name() const { return {track->config.phase, track->config.id, track->config.profile}; }
};

// `others`: the parameters that the address has beside those that ask for a board.
// InvalidArgumentError and NotFoundError say what the request lacks.
absl::StatusOr<BoardQuery> ParseBoardQuery(const Request& request, const Transaction& reader,
                                           const ApiContext& context,
                                           const std::vector<std::string>& others = {});

// The main board of `live` as everybody sees it now, whoever asks. Errors of TrackAt.
absl::StatusOr<BoardQuery> PublicBoard(const Transaction& reader, const ApiContext& context,
                                       const TrackPtr& live);

// What a board is played and judged by now. Of a phase, only its name counts.
absl::StatusOr<TrackPtr> TrackInForce(const Transaction& reader, const ApiContext& context,
                                      const BoardName& board);

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

// The board of a track that is called so. InvalidArgumentError: it has none of this name.
absl::StatusOr<const scoring::BoardSpec*> FindBoard(const Track& track, const std::string& board);

// The ranked board `board` ("main") under the config of `track`, as of a moment, or with a rejudge
// taken as applied, without what can't be read. Errors of FindBoard.
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
