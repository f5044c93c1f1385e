#include "sim/elbow/readings.h"

#include <algorithm>
#include <cstdint>
#include <variant>

#include <absl/strings/str_format.h>

namespace myograde::sim {

std::vector<Reading> ElbowReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<ElbowFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"target", absl::StrFormat("%.3f rad", facts->target_angle)},
          {"error", absl::StrFormat("%.3f rad", facts->final_error)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

}  // namespace myograde::sim
