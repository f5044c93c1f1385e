#include "sim/manipulation/contacts.h"

namespace myograde::sim {

namespace {

ContactLabel LabelOf(ManipulationRules::CountsAs counts_as) {
  return counts_as == ManipulationRules::CountsAs::kArm ? kTouchArm : kTouchOther;
}

}  // namespace

ContactLabel LabelOf(int body, const Scene& scene, const ManipulationRules& rules) {
  constexpr int kWorld = 0;
  if (body == kWorld) return LabelOf(rules.world_contact);
  if (body < scene.first_arm_body) return LabelOf(rules.torso_contact);
  if (body < scene.first_prosthesis_body) return kTouchArm;
  if (body <= scene.last_prosthesis_body) return kTouchProsthesis;
  if (body == scene.start_body) return kTouchStart;
  if (body == scene.goal_body) return kTouchGoal;
  return kTouchOther;
}

TouchFrame ObjectTouch(const mjModel& model, const mjData& data, const Scene& scene,
                       const ManipulationRules& rules) {
  TouchFrame frame = {};
  for (int i = 0; i < data.ncon; ++i) {
    const int body1 = model.geom_bodyid[data.contact[i].geom1];
    const int body2 = model.geom_bodyid[data.contact[i].geom2];
    if (body1 == scene.object_body) {
      frame[LabelOf(body2, scene, rules)] = true;
    } else if (body2 == scene.object_body) {
      frame[LabelOf(body1, scene, rules)] = true;
    }
  }
  return frame;
}

bool TouchesGoalOnly(const TouchFrame& frame) {
  for (int label = 0; label < kContactLabels; ++label) {
    if (frame[label] != (label == kTouchGoal)) return false;
  }
  return true;
}

double ObjectForce(const mjModel& model, const mjData& data, const Scene& scene) {
  double sum = 0;
  for (int i = 0; i < data.ncon; ++i) {
    if (model.geom_bodyid[data.contact[i].geom1] != scene.object_body &&
        model.geom_bodyid[data.contact[i].geom2] != scene.object_body) {
      continue;
    }
    mjtNum force[6];
    mj_contactForce(&model, &data, i, force);
    sum += force[0];
  }
  return sum;
}

void ContactHistory::Clear() { *this = ContactHistory(hold_frames_); }

void ContactHistory::Add(const TouchFrame& frame) {
  ++frames_;
  for (int label = 0; label < kContactLabels; ++label) touched_[label] += frame[label];
  goal_only_run_ = TouchesGoalOnly(frame) ? goal_only_run_ + 1 : 0;
}

void ContactHistory::Report(ManipulationFacts& facts) const {
  facts.frames = frames_;
  facts.frames_arm = touched_[kTouchArm];
  facts.frames_prosthesis = touched_[kTouchProsthesis];
  facts.frames_start = touched_[kTouchStart];
  facts.frames_goal = touched_[kTouchGoal];
  facts.frames_other = touched_[kTouchOther];
  facts.goal_only_at_end = goal_only_run_ >= hold_frames_;
}

}  // namespace myograde::sim
