// Which board a request asks for, and how much of it the caller sees.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "scoring/track.h"
#include "server/api/context.h"
#include "server/board/acts.h"
#include "server/grading/tracks.h"
#include "server/http/request.h"
#include "server/store/reader_pool.h"

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

}  // namespace myograde::server
