// The episodes that a verb shows: which ones, and the logs to play them from.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <string>
#include <vector>

#include "protocol/lease/render_order.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

struct ShownEpisode {
  int64_t index = 0;
  std::string place;  // "best", "median", "worst" or "only" in a strip; else ""
  RenderEpisode order;
  int64_t steps = 0;  // in its log
};

struct ShownEpisodes {
  TrackConfig track;  // that they were played under
  std::vector<ShownEpisode> episodes;
};

// The episode of a log file. DataLossError if it is damaged or has no step, NotFoundError if it can't
// be opened. Other errors as of LogsUpTo.
absl::StatusOr<ShownEpisodes> EpisodeOfFile(const std::string& path);

// One episode of an evaluation with rows, its logs in `folder`. OutOfRangeError,
// FailedPreconditionError: there is no such episode, or no log of it. Other errors as of LogBytesOf.
absl::StatusOr<ShownEpisodes> EpisodeOfEvaluation(const Client& client, const Json& evaluation,
                                                  int64_t index, const std::string& folder);

// The best, the median and the worst of the episodes that can be shown, in the board's order.
// FailedPreconditionError if there is none. Other errors likewise.
absl::StatusOr<ShownEpisodes> StripOfEvaluation(const Client& client, const Json& evaluation,
                                                const std::string& folder);

}  // namespace myograde::server
