// Which board a request asks for, and how much of it the caller sees.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <httplib.h>

#include "scoring/track.h"
#include "server/api/context.h"
#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

// The track and board that a request names.
struct BoardQuery {
  TrackPtr track;
  std::string board;
  const scoring::BoardSpec* rules = nullptr;  // the track's
  // When its phase freezes it, as long as that has not been undone.
  absl::Time freezes = absl::InfiniteFuture();
  bool frozen = false;  // by the calendar
  bool whole = true;    // the caller sees all of it

  // What ended from then on is not shown. However the calendar is set, a row that is as late as the
  // freeze stays hidden.
  int64_t before_ms() const { return whole ? INT64_MAX : absl::ToUnixMillis(freezes); }
  // Boards of one config that look different.
  int view() const { return (frozen ? 2 : 0) + (whole ? 1 : 0); }
};

// InvalidArgumentError and NotFoundError say what the request lacks.
absl::StatusOr<BoardQuery> ParseBoardQuery(const httplib::Request& request, Reader& reader,
                                           const ApiContext& context);

}  // namespace myograde::server
