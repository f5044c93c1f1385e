// The C++ kit: a policy is a class with Reset and Act, and a main that hands
// it to RunPolicy. The kit speaks the protocol (protocol/README.md): it says
// hello until it is welcomed, answers what is asked, and gives the same answer
// again when the same step is asked again. Installed as <myograde/kit.h>; needs
// LCM's headers, and nothing else of this project than the message types.
//
//   class Still : public myograde::Policy {
//     void Act(std::span<const double>, std::span<double> action) override {
//       std::ranges::fill(action, -1.0);
//     }
//   };
//   int main() {
//     Still policy;
//     return myograde::RunPolicy(policy);
//   }
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "myograde/leg_parameter_set_t.hpp"
#include "myograde/part_t.hpp"
#include "myograde/welcome_t.hpp"

namespace myograde {

// One episode as the policy may know it.
struct EpisodeInfo {
  int64_t episode = 0;       // place in this process's run, from 0
  uint64_t policy_seed = 0;  // for the policy's own random numbers
};

class Policy {
 public:
  virtual ~Policy() = default;

  // For logs; at most 64 bytes.
  virtual std::string Name() const { return "policy"; }

  // True: actions are direct (muscles in [0, 1], prosthesis targets in rad);
  // false: every entry is normalized to [-1, 1].
  virtual bool Direct() const { return false; }

  // Locomotion: parameter sets of the leg to use instead of the defaults, sent
  // with the hello. Each index 0 to 4 at most once.
  virtual std::vector<leg_parameter_set_t> LegSets() const { return {}; }

  // Called once, with the track, the layout of the vectors and their bounds.
  virtual void Start(const welcome_t& /*welcome*/) {}

  // Called at the beginning of each episode.
  virtual void Reset(const EpisodeInfo& /*episode*/) {}

  // Fills `action` (welcome.action_size entries, all 0 before the call) for
  // `observation` (welcome.observation_size entries). All entries must be
  // finite: anything else ends the episode as the policy's fault.
  virtual void Act(std::span<const double> observation, std::span<double> action) = 0;

  // True once after GiveUp was called; for the kit.
  bool TakeGivingUp() { return std::exchange(gives_up_, false); }

 protected:
  // Called in Act: ends the episode as it stands, and `action` is not looked at.
  void GiveUp() { gives_up_ = true; }

 private:
  bool gives_up_ = false;
};

// The entries of the part `name` in a vector: an observation with welcome.observation_parts, or an
// action with welcome.action_parts. Empty if the track has no such part.
template <typename Number>
std::span<Number> PartOf(std::span<Number> vector, const std::vector<part_t>& parts,
                         std::string_view name) {
  for (const part_t& part : parts) {
    if (part.name == name) {
      return vector.subspan(static_cast<size_t>(part.offset), static_cast<size_t>(part.size));
    }
  }
  return {};
}

// Plays until the grader ends the process: after the last episode it sends SIGTERM, and this
// returns 0 for main to end in order (unless the program handles that signal itself). The bus is
// the environment variable MYOGRADE_LCM_URL. Returns an exit status otherwise: 1 if there is no bus
// or it was lost, if no grader is on it for a minute or none was heard for ten, or if the grader
// refused the policy; stderr says why. An exception of the policy passes through.
int RunPolicy(Policy& policy);

}  // namespace myograde
