// When an episode came to what its details tell of the object: times in s of simulated time.
#pragma once

#include <optional>

#include "protocol/tracks/manipulation/details.h"
#include "sim/manipulation/contacts.h"

namespace myograde::sim {

class ObjectTimes {
 public:
  // Takes the frame after a control step.
  void AddFrame(double time, const TouchFrame& frame);
  // Takes a force on the object that is larger than all before it.
  void AddPeak(double time) { peak_force_ = time; }

  void Report(ManipulationDetails& details) const;

 private:
  std::optional<double> first_contact_;
  std::optional<double> handover_;
  std::optional<double> last_arm_;  // the arm's latest touch
  std::optional<double> release_;
  std::optional<double> goal_contact_;
  std::optional<double> peak_force_;
};

}  // namespace myograde::sim
