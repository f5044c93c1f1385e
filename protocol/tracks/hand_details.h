// What is measured besides the facts in an episode of a track of the hand.
#pragma once

#include <array>
#include <optional>

#include "protocol/tracks/details.h"
#include "protocol/tracks/hand.h"

namespace myograde {

struct HandDetails {
  static constexpr auto kJoints = kHandJointNames;

  std::optional<double> solved_time;  // s, the official flag was up for the first time; none: never
  std::array<JointRange, kJoints.size()> joint_ranges = {};  // rad

  // Visits every detail with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("solved_time", self.solved_time);
    visit("joint_ranges", ByName{kJoints, self.joint_ranges});
  }
};

}  // namespace myograde
