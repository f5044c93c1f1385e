// The muscles of the person with the prosthetic leg, as a policy can know them: what each could pull
// at its present length and speed, around which joints, and which activations give wanted torques.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/length_terms.h"

namespace myograde::baseline {

inline constexpr int kMuscles = 54;
inline constexpr double kControlStep = 0.005;  // s

// What an observation says of the muscles; all in the order of the action.
struct MuscleState {
  std::array<double, kLengthJoints> angles{};  // rad, in LengthTerms' order
  std::array<double, kMuscles> activation{};   // 0 to 1
  std::array<double, kMuscles> length{};       // m
  std::array<double, kMuscles> velocity{};     // m/s, lengthening positive
};

// Torques in N m around the joints of LengthTerms, and how much each of them matters.
struct TorqueGoal {
  std::array<double, kLengthJoints> torque{};
  std::array<double, kLengthJoints> weight{};
};

// What the muscles' present activations make of torque around each joint, in N m.
std::array<double, kLengthJoints> MuscleTorques(const MuscleState& state);

// Turns wanted torques into excitations, step by step: it remembers its last answer, which the next
// search starts from.
class MuscleAllocator {
 public:
  // `effort`: what a squared activation costs, in squared N m of missed torque.
  explicit MuscleAllocator(double effort) : effort_(effort) {}

  void Reset() { last_.fill(0); }

  // Excitations in [0, 1] that bring the activations, within a control step of 5 ms and as far as
  // the muscles' own delay lets them, to where they make the torques of `goal`.
  void Allocate(const MuscleState& state, const TorqueGoal& goal,
                std::span<double, kMuscles> excitations);

 private:
  double effort_;
  std::array<double, kMuscles> last_{};
};

// Where a muscle's length and velocity stand among the observation's sorted entries: entry i of the
// result is for muscle i of the action.
const std::array<size_t, kMuscles>& SortedPlaces();

}  // namespace myograde::baseline
