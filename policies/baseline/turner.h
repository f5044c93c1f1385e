// The controller of the baseline of the track reorientation: it has turns of a die that a search
// found, and plays the one that brought dice nearest to the goal. Meanwhile it looks at the hand
// alone.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "policies/baseline/hand.h"
#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

inline constexpr size_t kTurnerObservation = 102;

// Postures that the hand (hand.h) takes one after the other, and where dice have been then.
struct Turn {
  // A pose that some of the dice that were tried kept for as long as a success takes.
  struct Outcome {
    std::array<double, 3> rotation{};  // Euler angles in rad
    std::array<double, 3> place{};     // m, from where a die starts
    double share = 0;                  // of the dice
  };

  std::array<int, 4> begins{};  // steps, for each posture
  std::array<HandPosture, 4> postures{};
  std::vector<Outcome> outcomes;

  // How likely the turn is to reach a goal, up to a factor; `rotation` and `place` as of outcomes.
  double Promise(std::span<const double, 3> rotation, std::span<const double, 3> place) const;
};

// What a search may change of a turn: when its postures after the first begin (steps), and what
// each of the four adds to a cupped hand (rad), by groups of joints.
std::span<const ParameterInfo> TurnParameters();

// A turn without outcomes; `numbers` in the order of TurnParameters().
Turn MakeTurn(std::span<const double> numbers);

// The turns in the JSON file `path`, under "turns": {"begins": [three numbers], "postures": [four
// lists], both as MakeTurn has them, "outcomes": [seven numbers each: rotation, place, share]}.
// std::runtime_error with one sentence if the file can't be read or isn't so.
std::vector<Turn> ReadTurns(const std::string& path);

class Turner {
 public:
  explicit Turner(std::vector<Turn> turns) : turns_(std::move(turns)) {}

  void Reset();
  // Direct actions: excitations in [0, 1]. The first observation after a reset tells the goal.
  void Act(std::span<const double, kTurnerObservation> observation,
           std::span<double, kHandActions> action);

 private:
  std::vector<Turn> turns_;
  Hand hand_{0.01};
  const Turn* turn_ = nullptr;  // one of turns_, from the first step of an episode on
  int step_ = 0;
};

}  // namespace myograde::baseline
