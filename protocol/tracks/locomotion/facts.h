// What the simulator measures in an episode of locomotion, and the names of its endings.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "protocol/base/outcome.h"

namespace myograde {

struct LocomotionEnd {
  static constexpr EpisodeEnd kFinished{"finished"};  // reached the end of the course
  static constexpr EpisodeEnd kFell{"fell"};
  static constexpr EpisodeEnd kOffTrack{"off-track"};
};

struct LocomotionReason {
  static constexpr FailureReason kFell{"fell"};
  static constexpr FailureReason kOffTrack{"off-track"};
};

struct LocomotionFacts {
  static constexpr std::string_view kTrack = "locomotion";
  static constexpr std::array kEnds = {LocomotionEnd::kFinished, LocomotionEnd::kFell,
                                       LocomotionEnd::kOffTrack};
  static constexpr std::array kReasons = {LocomotionReason::kFell, LocomotionReason::kOffTrack};
  static constexpr int kActionSize = 55;

  int course = 0;            // 0 flat, 1 hilly, 2 rough, 3 stairs, 4 mixed
  double distance = 0;       // m, largest progress along the course, in [0, 100]
  double start_y = 0;        // m, where the profile counts distance from
  double min_y = 0;          // m, smallest root y over the steps (before the first: at the start)
  double final_y = 0;        // m
  double effort_sum = 0;     // sum over steps of mean(activation^2)
  double pain_sum = 0;       // sum over steps of mean(clipped limit torque)/1000
  bool solved = false;       // the official flag at the last step
  double reported_time = 0;  // s, official reported time (300.0 after a fall)

  // Visits every fact with its JSON key; `self` may be const.
  template <typename Self, typename Visitor>
  static void Visit(Self& self, Visitor&& visit) {
    visit("course", self.course);
    visit("distance", self.distance);
    visit("start_y", self.start_y);
    visit("min_y", self.min_y);
    visit("final_y", self.final_y);
    visit("effort_sum", self.effort_sum);
    visit("pain_sum", self.pain_sum);
    visit("solved", self.solved);
    visit("reported_time", self.reported_time);
  }
};

}  // namespace myograde
