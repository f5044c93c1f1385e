// Which episodes to look at to see what an evaluation is like.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/track.h"
#include "server/store/rows.h"

namespace myograde::server {

// Places in the rows that they are of.
struct Highlights {
  size_t best = 0;
  size_t median = 0;  // of an even number of episodes the better one of the middle two
  size_t worst = 0;

  bool operator==(const Highlights&) const = default;
};

// Episodes in the order of the numbers that rank the main board, successes first where those are equal,
// and then by index; only of episodes that have a log, without which there is nothing to look at.
// nullopt: none has one. A damaged row (store/damage.h) if one is unreadable.
absl::StatusOr<std::optional<Highlights>> HighlightsOf(const scoring::TrackScoring& scoring,
                                                       const std::vector<EpisodeRow>& rows);

}  // namespace myograde::server
