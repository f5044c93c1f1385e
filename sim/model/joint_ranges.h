// The ranges that joints went through in an episode, and the limits that the model gives them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include <mujoco/mujoco.h>

#include "protocol/tracks/details.h"

namespace myograde::sim {

// `joints` are ids of joints with one coordinate.
template <size_t n>
class JointRanges {
 public:
  JointRanges(const mjModel& model, const std::array<int, n>& joints) {
    for (size_t i = 0; i < n; ++i) {
      qpos_[i] = model.jnt_qposadr[joints[i]];
      ranges_[i].limit_low = model.jnt_range[2 * joints[i]];
      ranges_[i].limit_high = model.jnt_range[2 * joints[i] + 1];
    }
  }

  // Of the model's first n joints.
  explicit JointRanges(const mjModel& model) : JointRanges(model, [] {
    std::array<int, n> first = {};
    for (size_t i = 0; i < n; ++i) first[i] = static_cast<int>(i);
    return first;
  }()) {}

  // Takes the angles after a control step, the episode's first one or a further one.
  void Add(const mjData& data, bool first) {
    for (size_t i = 0; i < n; ++i) {
      const double angle = data.qpos[qpos_[i]];
      ranges_[i].low = first ? angle : std::min(ranges_[i].low, angle);
      ranges_[i].high = first ? angle : std::max(ranges_[i].high, angle);
    }
  }

  const std::array<JointRange, n>& ranges() const { return ranges_; }

 private:
  std::array<int, n> qpos_ = {};
  std::array<JointRange, n> ranges_ = {};
};

}  // namespace myograde::sim
