// The order of an evaluation's episodes, by the rules of its board.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/aggregate.h"
#include "scoring/track.h"

namespace myograde::scoring {

// The end of an episode and the reason of its failure, where it is a phantom: a trial that the
// official code counts and ends at once, because the one before was solved.
inline constexpr std::string_view kPhantom = "phantom";

// The indices of `episodes`, first place first, as the track's main board would rank evaluations of
// one episode each, without phantoms; of equal ones the earlier comes first. Those that it would
// not rank, the faults, come last. InvalidArgumentError if an index occurs twice.
absl::StatusOr<std::vector<int64_t>> EpisodesInOrder(
    const TrackScoring& scoring, const std::vector<JudgedEpisode>& episodes);

struct PickedEpisode {
  std::string_view place;  // "best", "median", "worst"; "only"
  int64_t index = 0;
};

// The first, the one in the middle (of an even number the better one) and the last of an order; of
// two the first and the last; of one that one.
std::vector<PickedEpisode> BestMedianWorst(const std::vector<int64_t>& order);

}  // namespace myograde::scoring
