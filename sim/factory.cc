#include "sim/factory.h"

#include "sim/locomotion/locomotion.h"
#include "sim/manipulation/manipulation.h"

namespace myograde::sim {

absl::StatusOr<std::unique_ptr<Environment>> MakeEnvironment(const TrackConfig& config,
                                                             const std::string& cache_dir) {
  switch (config.kind) {
    case TrackKind::kManipulation:
      return MakeManipulation(config, cache_dir);
    case TrackKind::kLocomotion:
      return MakeLocomotion(config, cache_dir);
  }
  return absl::InvalidArgumentError("the track config names no known track");
}

}  // namespace myograde::sim
