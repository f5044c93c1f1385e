// What the object touches: labels of one frame, and their history over an
// episode. A frame is a control step's final state.
#pragma once

#include <array>
#include <cstdint>

#include <mujoco/mujoco.h>

#include "protocol/tracks/episode_facts.h"
#include "sim/manipulation/rules.h"
#include "sim/manipulation/scene.h"

namespace myograde::sim {

enum ContactLabel {
  kTouchArm,  // the muscle arm from the clavicle down
  kTouchProsthesis,
  kTouchStart,  // start pillar
  kTouchGoal,   // goal pillar
  kTouchOther,
  kContactLabels,
};

// One frame: which of the labels the object touches.
using TouchFrame = std::array<bool, kContactLabels>;

// The label of a body other than the object. What world and torso count as is the rules'.
ContactLabel LabelOf(int body, const Scene& scene, const ManipulationRules& rules);

// Labels of everything that has an entry with the object in the list of
// contacts, whatever its distance and force.
TouchFrame ObjectTouch(const mjModel& model, const mjData& data, const Scene& scene,
                       const ManipulationRules& rules);

// True if the frame touches the goal pillar and nothing else.
bool TouchesGoalOnly(const TouchFrame& frame);

// Sum of the normal forces of all contacts with the object, in N.
double ObjectForce(const mjModel& model, const mjData& data, const Scene& scene);

// Counts frames by label, and how long the object has touched the goal alone.
class ContactHistory {
 public:
  explicit ContactHistory(int64_t hold_frames) : hold_frames_(hold_frames) {}

  void Clear();
  void Add(const TouchFrame& frame);

  // Fills the frame counts and goal_only_at_end.
  void Report(ManipulationFacts& facts) const;

 private:
  int64_t hold_frames_;
  int64_t frames_ = 0;
  std::array<int64_t, kContactLabels> touched_ = {};
  int64_t goal_only_run_ = 0;
};

}  // namespace myograde::sim
