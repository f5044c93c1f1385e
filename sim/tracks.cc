#include "sim/tracks.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/tracks/baoding/track.h"
#include "protocol/tracks/chasetag/track.h"
#include "protocol/tracks/elbow/track.h"
#include "protocol/tracks/locomotion/track.h"
#include "protocol/tracks/manipulation/track.h"
#include "protocol/tracks/relocation/track.h"
#include "protocol/tracks/reorientation/track.h"
#include "sim/baoding/baoding.h"
#include "sim/chasetag/chasetag.h"
#include "sim/elbow/elbow.h"
#include "sim/elbow/model.h"
#include "sim/elbow/readings.h"
#include "sim/elbow/telemetry.h"
#include "sim/locomotion/locomotion.h"
#include "sim/locomotion/model.h"
#include "sim/locomotion/readings.h"
#include "sim/locomotion/telemetry.h"
#include "sim/manipulation/manipulation.h"
#include "sim/manipulation/model.h"
#include "sim/manipulation/readings.h"
#include "sim/manipulation/telemetry.h"
#include "sim/model/model.h"
#include "sim/relocation/relocation.h"
#include "sim/reorientation/reorientation.h"

namespace myograde::sim {

std::span<const SimulatedTrack> SimulatedTracks() {
  static const std::array tracks = {
      SimulatedTrack{&ManipulationTrack(), &ManipulationModel(), &ManipulationView(), MakeManipulation,
                     ManipulationRewardTerms(), ManipulationReadings, WatchManipulation},
      SimulatedTrack{&LocomotionTrack(), &LocomotionModel(), &LocomotionView(), MakeLocomotion,
                     LocomotionRewardTerms(), LocomotionReadings, WatchLocomotion},
      SimulatedTrack{&ReorientationTrack(), &ReorientationModel(), &ReorientationView(),
                     MakeReorientation, ReorientationRewardTerms(), ReorientationReadings,
                     WatchReorientation},
      SimulatedTrack{&BaodingTrack(), &BaodingModel(), &BaodingView(), MakeBaoding,
                     BaodingRewardTerms(), BaodingReadings, WatchBaoding},
      SimulatedTrack{&RelocationTrack(), &RelocationModel(), &RelocationView(), MakeRelocation,
                     RelocationRewardTerms(), RelocationReadings, WatchRelocation},
      SimulatedTrack{&ChaseTagTrack(), &ChaseTagModel(), &ChaseTagView(), MakeChaseTag,
                     ChaseTagRewardTerms(), ChaseTagReadings, WatchChaseTag},
      SimulatedTrack{&ElbowTrack(), &ElbowModel(), &ElbowView(), MakeElbow,
                     ElbowRewardTerms(), ElbowReadings, WatchElbow},
  };
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
