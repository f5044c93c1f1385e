#include "sim/manipulation/readings.h"

#include <algorithm>
#include <cstdint>
#include <variant>

#include <absl/strings/str_format.h>

namespace myograde::sim {

std::vector<Reading> ManipulationReadings(const EpisodeFacts& episode) {
  const auto* facts = std::get_if<ManipulationFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  return {{"to the goal", absl::StrFormat("%.3f m", facts->final_goal_distance)},
          {"highest lift", absl::StrFormat("%.3f m", facts->max_height)},
          {"peak force", absl::StrFormat("%.1f N", facts->peak_force)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

}  // namespace myograde::sim
