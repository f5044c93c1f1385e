// The further episodes of a board's submissions: rejudges of the purpose "seeds". They are part of
// its statistics and of no rank.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "scoring/aggregate.h"
#include "server/grading/tracks.h"
#include "server/store/reader.h"

namespace myograde::server {

// An evaluation of further episodes that is played, or will be.
struct FurtherItem {
  int64_t rejudge = 0;
  int64_t evaluation = 0;
  EvaluationState state = EvaluationState::kQueued;  // neither cancelled nor grader_error
  std::vector<uint64_t> seeds;                       // by index of its episodes
  bool dropped = false;  // counts no more, but somebody may have looked
};
// By submission, oldest rejudge first.
using FurtherItems = std::map<int64_t, std::vector<FurtherItem>>;

// Of the submissions on the board of a config.
absl::StatusOr<FurtherItems> FurtherItemsOf(Reader& reader, const std::string& config);

// The seeds that a rejudge plays, by index.
absl::StatusOr<std::vector<uint64_t>> SeedsOfRejudge(Reader& reader, const RejudgeRow& rejudge);

// Gives every seed one index, after those of all episodes that rank, so that the same further episode
// of two submissions makes a pair.
class FurtherIndices {
 public:
  int64_t Of(uint64_t seed) {
    return indices_.try_emplace(seed, kMaxEpisodes + std::ssize(indices_)).first->second;
  }

 private:
  std::map<uint64_t, int64_t> indices_;
};

struct Further {
  std::vector<scoring::JudgedEpisode> episodes;  // each seed once
  std::set<int64_t> looks;                       // TestedRow::further
};

// The episodes of items that ended before `before_ms`. A damaged row (store/damage.h) if one can't be
// read.
absl::StatusOr<Further> FurtherEpisodes(
    Reader& reader, const Track& track, const std::vector<FurtherItem>& items, int64_t before_ms,
    FurtherIndices& indices);

}  // namespace myograde::server
