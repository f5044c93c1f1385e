#include "policies/baseline/reacher.h"

#include <algorithm>
#include <utility>

namespace myograde::baseline {
namespace {

constexpr double kArmEffort = 0.05;  // squared N m for a fully active muscle
constexpr double kMostIntegral = 6;  // N m
constexpr double kHandWeight = 20;   // what torques of the hand's joints matter more
constexpr size_t kArmAngles = 1, kProsthesisAngles = 77, kStart = 142, kGoal = 145,
                 kArmActivations = 153;
constexpr std::array<double, 2> kStartMiddle = {-0.4, -0.25}, kGoalMiddle = {0.4, -0.25};  // m
// Where the independent joints stand among the observation's 38.
constexpr size_t kElevationPlane = 10, kElevation = 11, kRotation = 13;
// The joints of the servos among the observation's 26 of the prosthesis.
constexpr std::array<size_t, kProsthesis> kServoJoints = {0, 1,  2,  3,  4,  5,  6,  7, 8,
                                                          9, 10, 11, 12, 15, 19, 22, 23};

size_t Place(int joint) {
  if (joint == 0) return kElevationPlane;
  return joint == 1 ? kElevation : kRotation + static_cast<size_t>(joint) - 2;
}

// A way from 0 to 1 without jumps of its speed.
double Smooth(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

}  // namespace

Reacher::Reacher(ReacherPlan plan) : plan_(std::move(plan)), allocator_(kArmEffort) {}

void Reacher::Reset() {
  first_ = true;
  sum_.fill(0);
  allocator_.Reset();
}

void Reacher::Act(std::span<const double, kReacherObservation> observation,
                  std::span<double, kReacherAction> action) {
  ArmState state;
  for (int j = 0; j < kArmJoints; ++j) {
    state.angles[j] = observation[kArmAngles + Place(j)];
    // Differences of angles: the profiles give velocities in different units.
    if (!first_) state.velocities[j] = (state.angles[j] - last_angles_[j]) / kArmControlStep;
  }
  for (size_t i = 0; i < kArmMuscles; ++i) state.activation[i] = observation[kArmActivations + i];
  last_angles_ = state.angles;
  if (first_) {
    places_ = {1, observation[kStart] - kStartMiddle[0], observation[kStart + 1] - kStartMiddle[1],
               observation[kGoal] - kGoalMiddle[0], observation[kGoal + 1] - kGoalMiddle[1]};
    std::copy_n(state.angles.begin(), kCarrying, first_angles_.begin());
    for (int i = 0; i < kProsthesis; ++i) {
      first_prosthesis_[i] = observation[kProsthesisAngles + kServoJoints[i]];
    }
  }

  // Where both arms should be now: between two way points, the first of which is the start.
  const double time = observation[0];
  size_t next = 0;
  while (next + 1 < plan_.way.size() && time >= plan_.way[next].time) ++next;
  const WayPoint& to = plan_.way[next];
  const WayPoint* from = next == 0 ? nullptr : &plan_.way[next - 1];
  const double began = from == nullptr ? 0 : from->time;
  const double share = Smooth((time - began) / std::max(to.time - began, kArmControlStep));
  const auto angle = [this](const WayPoint& point, int joint) {
    double sum = 0;
    for (int k = 0; k < kPlaces; ++k) sum += point.arm[joint][k] * places_[k];
    return sum;
  };

  ArmTorques goal = WeightTorques(state);
  ArmTorques weight;
  weight.fill(1);
  for (int j = 0; j < kCarrying; ++j) {
    const double before = from == nullptr ? first_angles_[j] : angle(*from, j);
    const double target = before + share * (angle(to, j) - before);
    const double speed = first_ ? 0 : (target - last_target_[j]) / kArmControlStep;
    last_target_[j] = target;
    const double error = target - state.angles[j];
    sum_[j] = std::clamp(sum_[j] + plan_.integral[j] * error * kArmControlStep, -kMostIntegral,
                         kMostIntegral);
    goal[j] +=
        plan_.stiffness[j] * error + plan_.damping[j] * (speed - state.velocities[j]) + sum_[j];
  }
  const double grip = (from == nullptr ? 0 : from->grip) * (1 - share) + to.grip * share;
  for (int j = kCarrying; j < kArmJoints; ++j) {
    const double target = plan_.open[j - kCarrying] +
                          grip * (plan_.closed[j - kCarrying] - plan_.open[j - kCarrying]);
    goal[j] = plan_.hand_stiffness * (target - state.angles[j]) -
              plan_.hand_damping * state.velocities[j];
    weight[j] = kHandWeight;
  }
  allocator_.Allocate(state, goal, weight, action.first<kArmMuscles>());
  for (int i = 0; i < kProsthesis; ++i) {
    const double before = from == nullptr ? first_prosthesis_[i] : from->prosthesis[i];
    action[kArmMuscles + i] = before + share * (to.prosthesis[i] - before);
  }
  first_ = false;
}

}  // namespace myograde::baseline
