// The layout of observation and action vectors: the one table that the
// welcome message, `myograde spec`, the documentation and the tests read.
// Offsets follow tables 3 and 4 of the MyoChallenge 2024 paper.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "protocol/frames.h"
#include "protocol/track_config.h"

namespace myograde {

struct Part {
  std::string_view name;     // "arm_qpos"
  int offset;
  int size;
  std::string_view unit;     // "rad"
  std::string_view meaning;  // one sentence, with frame and order
};

// Observation parts in order, without gaps: 222 (manipulation) or 365 entries.
std::span<const Part> ObservationLayout(TrackKind kind);
// Action parts in order: 80 or 55 entries.
std::span<const Part> ActionLayout(TrackKind kind);

int ObservationSize(TrackKind kind);
int ActionSize(TrackKind kind);

// The name of each entry, in order ("myohand_qpos.elbow_flexion", "action DELT1").
std::span<const std::string_view> ObservationNames(TrackKind kind);
std::span<const std::string_view> ActionNames(TrackKind kind);

struct Bounds {
  double low;
  double high;
};

// Bounds of each action entry in a convention: [-1, 1], or for `direct` muscles
// [0, 1] and prosthesis targets in rad; the leg's set selection is [0, 4] in both.
std::vector<Bounds> ActionBounds(TrackKind kind, ActionConvention convention);
// Bounds that hold for observations in ordinary play (joint ranges where they
// exist, else wide); not enforced.
std::vector<Bounds> ObservationBounds(TrackKind kind);

double ControlPeriod(TrackKind kind);  // s: 0.01 and 0.005

}  // namespace myograde
