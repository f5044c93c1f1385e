#include "sim/manipulation/object_times.h"

namespace myograde::sim {

void ObjectTimes::AddFrame(double time, const TouchFrame& frame) {
  if (frame[kTouchArm]) {
    if (!first_contact_) first_contact_ = time;
    last_arm_ = time;
    release_.reset();  // what looked like it was none
  }
  if (frame[kTouchProsthesis] && first_contact_) {
    if (!handover_) handover_ = time;
    if (!frame[kTouchArm]) release_ = last_arm_;
  }
  if (frame[kTouchGoal] && !goal_contact_) goal_contact_ = time;
}

void ObjectTimes::Report(ManipulationDetails& details) const {
  details.first_contact_time = first_contact_;
  details.handover_time = handover_;
  details.release_time = release_;
  details.goal_contact_time = goal_contact_;
  details.peak_force_time = peak_force_;
}

}  // namespace myograde::sim
