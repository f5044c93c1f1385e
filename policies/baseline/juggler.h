// The controller of the baseline of the track baoding: a posture that is linear in a few features
// of the observation, which the hand follows (hand.h).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "policies/baseline/hand.h"
#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

inline constexpr size_t kJugglerObservation = 86;

// What a search may change: of every joint its angle (rad), and for each feature what it adds (rad)
// to joints that move together.
std::span<const ParameterInfo> JugglerParameters();

class Juggler {
 public:
  // `numbers`: in the order of JugglerParameters().
  explicit Juggler(std::span<const double> numbers) : numbers_(numbers.begin(), numbers.end()) {}

  void Reset() { hand_.Reset(); }
  // Direct actions: excitations in [0, 1].
  void Act(std::span<const double, kJugglerObservation> observation,
           std::span<double, kHandActions> action);

 private:
  std::vector<double> numbers_;
  Hand hand_{0.025};
};

}  // namespace myograde::baseline
