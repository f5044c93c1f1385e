#include "policies/baseline/leg_muscles.h"

#include <algorithm>
#include <numeric>
#include <string_view>
#include <vector>

#include "policies/baseline/muscle_curves.h"
#include "policies/baseline/share_torques.h"

namespace myograde::baseline {
namespace {

constexpr int kSweeps = 12;  // of the coordinate descent

struct Entry {
  const char* name;
  std::vector<int> joints;
  MuscleParameters parameters;
  std::vector<double> weights;
};

struct Muscle {
  LengthTerms terms;
  MuscleParameters parameters;
  std::vector<double> weights;
};

const std::vector<Entry>& Entries() {
  static const std::vector<Entry> entries = {
#include "policies/baseline/leg_muscles.inc"
  };
  return entries;
}

// The right leg's counterparts of the joints from the left hip on: the legs are mirror images.
constexpr std::array kMirrored = {0, 1, 2, 10, 11, 12, 13};
constexpr int kLeft = 3;  // the first joint of the left leg

// The right leg's muscles first, as actions have them.
std::vector<Muscle> WholeLegs() {
  std::vector<Muscle> right, left;
  for (const Entry& entry : Entries()) {
    if (!std::string_view(entry.name).ends_with("_l")) continue;
    std::vector<int> joints = entry.joints;
    left.push_back({LengthTerms(joints), entry.parameters, entry.weights});
    for (int& joint : joints) joint = kMirrored[joint - kLeft];
    right.push_back({LengthTerms(joints), entry.parameters, entry.weights});
  }
  right.insert(right.end(), left.begin(), left.end());
  return right;
}

const std::vector<Muscle>& Muscles(Legs legs) {
  static const std::vector<Muscle> prosthetic = [] {
    std::vector<Muscle> out;
    for (const Entry& entry : Entries()) {
      out.push_back({LengthTerms(entry.joints), entry.parameters, entry.weights});
    }
    return out;
  }();
  static const std::vector<Muscle> whole = WholeLegs();
  return legs == Legs::kWhole ? whole : prosthetic;
}

}  // namespace

const std::array<size_t, kMuscles>& SortedPlaces() {
  static const std::array<size_t, kMuscles> places = [] {
    std::array<size_t, kMuscles> order, out;
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(order, {}, [](size_t i) { return std::string_view(Entries()[i].name); });
    for (size_t place = 0; place < kMuscles; ++place) out[order[place]] = place;
    return out;
  }();
  return places;
}

std::array<double, kLengthJoints> MuscleTorques(const MuscleState& state, Legs legs) {
  std::array<double, kLengthJoints> torques{};
  const std::vector<Muscle>& muscles = Muscles(legs);
  for (size_t i = 0; i < muscles.size(); ++i) {
    const Muscle& muscle = muscles[i];
    std::array<double, kMostJoints> arms{};
    muscle.terms.AddSlopes(muscle.weights, state.angles, arms);
    const MusclePull pull = PullOf(muscle.parameters, state.length[i], state.velocity[i]);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torques[muscle.terms.joint(j)] -=
          arms[j] * (pull.active * state.activation[i] + pull.passive);
    }
  }
  return torques;
}

void MuscleAllocator::Allocate(const MuscleState& state, const TorqueGoal& goal,
                               std::span<double> excitations) {
  const double control_step = legs_ == Legs::kWhole ? kWholeControlStep : kControlStep;
  // Torque of each muscle at full activation, and what is missing of the goal.
  std::array<std::array<double, kMostJoints>, kWholeMuscles> torque{};
  std::array<double, kLengthJoints> missing = goal.torque;
  std::array<ActivationBounds, kWholeMuscles> bounds;
  const std::vector<Muscle>& muscles = Muscles(legs_);
  for (size_t i = 0; i < muscles.size(); ++i) {
    const Muscle& muscle = muscles[i];
    std::array<double, kMostJoints> arms{};
    muscle.terms.AddSlopes(muscle.weights, state.angles, arms);
    const MusclePull pull = PullOf(muscle.parameters, state.length[i], state.velocity[i]);
    bounds[i] = Reachable(state.activation[i], control_step);
    last_[i] = std::clamp(last_[i], bounds[i].low, bounds[i].high);
    for (int j = 0; j < muscle.terms.joints(); ++j) {
      torque[i][j] = -arms[j] * pull.active;
      missing[muscle.terms.joint(j)] += arms[j] * pull.passive - torque[i][j] * last_[i];
    }
  }
  ShareTorques(muscles, torque, bounds, goal.weight, effort_, kSweeps, missing,
               std::span(last_).first(muscles.size()));
  for (size_t i = 0; i < muscles.size(); ++i)
    excitations[i] = Excitation(state.activation[i], last_[i], control_step);
}

}  // namespace myograde::baseline
