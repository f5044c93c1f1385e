// From an organiser's request for further episodes to the rejudges that have them played.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/further_episodes.h"
#include "server/store/rejudges.h"

namespace myograde::server {

// The body of POST /v1/phases/NAME/more-seeds.
struct MoreSeedsRequest {
  std::string phase;
  std::string board;      // whose order is asked about
  int64_t episodes = 0;   // further ones that each of the submissions is to have in the end
  // First and last rank by the rules; 0 and 0: all rows that share a group.
  std::pair<int64_t, int64_t> places = {0, 0};
  std::string reason;
};
// InvalidArgumentError names the key and says what is allowed.
absl::StatusOr<MoreSeedsRequest> ParseMoreSeeds(const nlohmann::json& body,
                                                const std::string& phase);

// The further seeds of a phase that has `own` seeds: those that its secret gives after them.
std::vector<uint64_t> FurtherSeeds(const std::string& secret, const std::string& phase, size_t own,
                                   int64_t count);

// The further seeds of a phase from the first to the last that was played, or will be.
absl::StatusOr<std::vector<uint64_t>> PlayedFurtherSeeds(Reader& reader, const std::string& phase,
                                                         const std::string& secret);

// What the store is to create: one rejudge for all submissions that lack the same seeds.
// FailedPreconditionError: nothing is undecided, or all have as many already; InvalidArgumentError:
// there are no such places, or too many episodes. `secret`: the phase's.
absl::StatusOr<std::vector<NewRejudge>> MakeFurtherRejudges(Reader& reader,
                                                            const ApiContext& context,
                                                            const MoreSeedsRequest& request,
                                                            const std::string& secret);

}  // namespace myograde::server
