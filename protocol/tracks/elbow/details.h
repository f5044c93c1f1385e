// What is measured in an episode of elbow besides its facts.
#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "protocol/tracks/details.h"

namespace myograde {

struct ElbowDetails {
  static constexpr std::string_view kTrack = "elbow";
  static constexpr std::array<std::string_view, 1> kJoints = {"r_elbow_flex"};

  // s; from then on to the end the error was at most `tolerance_rad`. None: it was not, at the end.
  std::optional<double> settle_time;
  std::array<JointRange, 1> joint_ranges = {};  // rad

  // Visits every detail with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("settle_time", self.settle_time);
    visit("joint_ranges", ByName{kJoints, self.joint_ranges});
  }
};

}  // namespace myograde
