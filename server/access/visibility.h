// What a phase of a challenge shows to its participants; sight.h applies it.
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

  bool operator==(const Visibility&) const = default;
};

}  // namespace myograde::server
