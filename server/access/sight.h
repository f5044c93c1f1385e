// What a caller may see of an evaluation: a phase of a challenge may withhold parts of it from its
// participants.
#pragma once

namespace myograde::server {

// What a phase shows to a team of its own evaluations. Organisers see everything.
struct Visibility {
  bool aggregate = true;   // the means that the board ranks by
  bool outcomes = true;    // outcome and reason of each episode
  bool metrics = true;     // metrics, steps and digests of each episode
  bool logs = true;        // facts and log of each episode
  bool output = true;      // what the policy printed, and the text of its faults
  bool seeds = true;       // false as long as committed seeds are not revealed
};

}  // namespace myograde::server
