// What the simulator measured in one episode: facts only, no verdict. The code in scoring/ turns
// them into an outcome and metrics, so new rules can score old episodes without simulating them
// again.
#pragma once

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <variant>

#include "protocol/base/fault_evidence.h"
#include "protocol/base/outcome.h"
#include "protocol/tracks/baoding/facts.h"
#include "protocol/tracks/chasetag/facts.h"
#include "protocol/tracks/elbow/facts.h"
#include "protocol/tracks/episode_details.h"
#include "protocol/tracks/locomotion/facts.h"
#include "protocol/tracks/manipulation/facts.h"
#include "protocol/tracks/relocation/facts.h"
#include "protocol/tracks/reorientation/facts.h"

namespace myograde {

// The registry of facts: one alternative per track.
using TrackFacts = std::variant<ManipulationFacts, LocomotionFacts, ElbowFacts, ReorientationFacts,
                                BaodingFacts, RelocationFacts, ChaseTagFacts>;

// Entries of the longest action.
inline constexpr int kMaxActionSize = []<typename... Facts>(std::variant<Facts...>*) {
  return std::max({Facts::kActionSize...});
}(static_cast<TrackFacts*>(nullptr));

// Identifies an episode's log. The format is in protocol/log/episode_log.h.
struct EpisodeLogInfo {
  std::string sha256;        // of the unpacked log (hex); "": none was kept
  int64_t bytes = 0;         // unpacked
  int64_t packed_bytes = 0;  // as stored
  int64_t steps = 0;         // steps in it; fewer than were played if it would have been too large
};

struct EpisodeFacts {
  int64_t index = 0;      // of the episode in the evaluation, from 0
  uint64_t seed = 0;
  EpisodeEnd end = EpisodeEnd::kFault;
  FaultEvidence fault;    // valid iff end == kFault
  int64_t steps = 0;      // control steps played
  double sim_time = 0;    // s of simulated time at the end
  int64_t clipped = 0;    // action entries clipped to their range
  std::string digest;     // SHA-256 (hex) over the states of every step
  std::string actions_digest;  // the same over the actions as received; "": unknown
  EpisodeLogInfo log;
  TrackFacts track;
  // Depends on the host's clock, so never part of a result's identity.
  double wall_s = 0;
  double policy_cpu_s = 0;
  // For pages, plots and reports; never part of a result's identity either.
  EpisodeDetails details = {};
};

}  // namespace myograde
