#include "sim/tracks.h"

#include <absl/strings/str_cat.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "protocol/base/status_macros.h"
#include "sim/baoding/track.h"
#include "sim/chasetag/track.h"
#include "sim/elbow/track.h"
#include "sim/locomotion/track.h"
#include "sim/manipulation/track.h"
#include "sim/model/model.h"
#include "sim/relocation/track.h"
#include "sim/reorientation/track.h"

namespace myograde::sim {

std::span<const SimulatedTrack> SimulatedTracks() {
  static const std::array tracks = {
      SimulatedManipulation(), SimulatedLocomotion(), SimulatedReorientation(), SimulatedBaoding(),
      SimulatedRelocation(),   SimulatedChaseTag(),   SimulatedElbow()};
  return tracks;
}

const SimulatedTrack& FindSimulatedTrack(const TrackKind& kind) {
  const std::span<const SimulatedTrack> all = SimulatedTracks();
  const auto found = std::ranges::find(all, &kind, &SimulatedTrack::kind);
  if (found == all.end()) std::abort();  // a test compares the registries
  return *found;
}

double DenseReward(std::span<const RewardTerm> terms, std::span<const double> values) {
  double sum = 0;
  for (size_t i = 0; i < terms.size(); ++i) {
    if (terms[i].weight != 0) sum += terms[i].weight * values[i];
  }
  return sum;
}

absl::StatusOr<std::unique_ptr<Environment>> MakeEnvironment(const TrackConfig& config,
                                                             const std::string& cache_dir) {
  for (const SimulatedTrack& track : SimulatedTracks()) {
    if (track.kind == config.kind) return track.make(config, cache_dir);
  }
  return absl::InternalError(absl::StrCat("track config ", config.id,
                                          ": its track is in the protocol's registry but not in "
                                          "the simulator's"));
}

absl::Status CompileModels(const std::string& cache_dir) {
  for (const SimulatedTrack& track : SimulatedTracks()) {
    RETURN_IF_ERROR(CompileModel(*track.model, cache_dir));
  }
  return absl::OkStatus();
}

}  // namespace myograde::sim
