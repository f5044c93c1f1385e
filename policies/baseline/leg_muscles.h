// The muscles of the person with the prosthetic leg, or with two whole ones, as a policy can know
// them: what each could pull at its present length and speed, around which joints, and which
// activations give wanted torques.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/length_terms.h"

namespace myograde::baseline {

enum class Legs { kProsthetic, kWhole };

inline constexpr int kMuscles = 54;       // with the prosthetic leg
inline constexpr int kWholeMuscles = 80;  // with two whole ones

inline constexpr double kControlStep = 0.005, kWholeControlStep = 0.01;  // s

// What an observation says of the muscles; all in the order of the action.
struct MuscleState {
  std::array<double, kLengthJoints> angles{};  // rad, in LengthTerms' order
  std::array<double, kWholeMuscles> activation{};  // 0 to 1
  std::array<double, kWholeMuscles> length{};      // m
  std::array<double, kWholeMuscles> velocity{};    // m/s, lengthening positive
};

// Torques in N m around the joints of LengthTerms, and how much each of them matters.
struct TorqueGoal {
  std::array<double, kLengthJoints> torque{};
  std::array<double, kLengthJoints> weight{};
};

// What the muscles' present activations make of torque around each joint, in N m.
std::array<double, kLengthJoints> MuscleTorques(const MuscleState& state,
                                                Legs legs = Legs::kProsthetic);

// Turns wanted torques into excitations, step by step: it remembers its last answer, which the next
// search starts from.
class MuscleAllocator {
 public:
  // `effort`: what a squared activation costs, in squared N m of missed torque.
  explicit MuscleAllocator(double effort, Legs legs = Legs::kProsthetic)
      : effort_(effort), legs_(legs) {}

  void Reset() { last_.fill(0); }

  // Excitations in [0, 1], one for each muscle, that bring the activations, within a control step
  // and as far as the muscles' own delay lets them, to where they make the torques of `goal`.
  void Allocate(const MuscleState& state, const TorqueGoal& goal, std::span<double> excitations);

 private:
  double effort_;
  Legs legs_;
  std::array<double, kWholeMuscles> last_{};
};

// Where a muscle's length and velocity stand among the observation's sorted entries: entry i of the
// result is for muscle i of the action.
const std::array<size_t, kMuscles>& SortedPlaces();

}  // namespace myograde::baseline
