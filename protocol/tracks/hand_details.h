// What is measured besides the facts in an episode of a track of the hand, or of the arm with it.
#pragma once

#include <array>
#include <optional>

#include "protocol/tracks/details.h"
#include "protocol/tracks/hand.h"

namespace myograde {

template <const auto& joint_names>
struct FlaggedDetails {
  static constexpr auto& kJoints = joint_names;

  std::optional<double> solved_time;  // s, the official flag was up for the first time; none: never
  std::array<JointRange, kJoints.size()> joint_ranges = {};  // rad

  // Visits every detail with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("solved_time", self.solved_time);
    visit("joint_ranges", ByName{kJoints, self.joint_ranges});
  }
};
using HandDetails = FlaggedDetails<kHandJointNames>;

}  // namespace myograde
