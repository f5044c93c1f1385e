#include "sim/locomotion/readings.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <variant>

#include <absl/strings/str_format.h>

namespace myograde::sim {

std::vector<Reading> LocomotionReadings(const EpisodeFacts& episode) {
  constexpr std::array<const char*, 5> kCourses = {"flat", "hilly", "rough", "stairs", "mixed"};
  const auto* facts = std::get_if<LocomotionFacts>(&episode.track);
  if (facts == nullptr) return {};
  const auto steps = static_cast<double>(std::max<int64_t>(episode.steps, 1));
  const auto course = static_cast<size_t>(facts->course);
  return {{"course", course < kCourses.size() ? kCourses[course] : "-"},
          {"distance", absl::StrFormat("%.1f m", facts->distance)},
          {"mean pain", absl::StrFormat("%.4f", facts->pain_sum / steps)},
          {"mean effort", absl::StrFormat("%.4f", facts->effort_sum / steps)}};
}

}  // namespace myograde::sim
