#include "policies/baseline/reacher_parameters.h"

#include <algorithm>
#include <array>
#include <deque>
#include <vector>

#include "policies/baseline/parameter_file.h"

namespace myograde::baseline {
namespace {

struct Range {
  const char* name;
  double low, high;  // rad
};

constexpr std::array<Range, kCarrying> kJoints = {{
    {"elevation_plane", -1.6, 2.27},
    {"elevation", 0, 3.14},
    {"rotation", -1.57, 2.1},
    {"elbow", 0, 2.27},
    {"pronation", -1.57, 1.57},
    {"deviation", -0.18, 0.44},
    {"wrist", -0.79, 0.79},
}};
constexpr int kThumb = 4, kFinger = 4, kFingers = 4;  // joints, joints of each finger, fingers
// The joints of the thumb, and those that all fingers share.
constexpr std::array<Range, kThumb + kFinger> kHand = {{
    {"thumb_abduction", -0.53, 0.7},
    {"thumb_flexion", -0.75, 0.85},
    {"thumb_middle", -0.8, 1.2},
    {"thumb_tip", -1.4, 1},
    {"finger_base", -0.2, 2.5},
    {"finger_abduction", -0.27, 0.27},
    {"finger_middle", -0.2, 2.5},
    {"finger_tip", -0.2, 2.2},
}};

// What a way point depends on.
enum class Depends { kNothing, kOnStart, kOnGoal };

struct Phase {
  const char* name;
  Depends depends;
  double grip;  // when it ends
  bool stays;   // the arm stays where it was in the phase before
};

constexpr std::array<Phase, 9> kPhases = {{
    {"beside", Depends::kOnStart, 0, false},
    {"at", Depends::kOnStart, 0, false},
    {"close", Depends::kOnStart, 1, true},
    {"lift", Depends::kOnStart, 1, false},
    {"carry", Depends::kNothing, 1, false},
    {"over", Depends::kOnGoal, 1, false},
    {"put", Depends::kOnGoal, 1, false},
    {"open", Depends::kOnGoal, 0, true},
    {"away", Depends::kOnGoal, 0, false},
}};
// Shoulder, arm and wrist of the prosthesis beside its body; the hand is open.
constexpr std::array<double, kProsthesis> kAside = {-0.4, -1.3, 0, 0.6};
constexpr double kMostSlope = 12;  // rad/m

// Takes the plan's numbers one after the other: the order of this walk is that of the parameters.
// `next(name, start, deviation, low, high)` is asked for each of them.
template <typename Next>
ReacherPlan Walk(Next next) {
  ReacherPlan plan;
  for (int j = 0; j < kCarrying; ++j) {
    const std::string joint = kJoints[j].name;
    const bool wrist = j >= 4;
    plan.stiffness[j] = next("stiffness_" + joint, wrist ? 8 : 50, wrist ? 1 : 6, 0, 300);
    plan.damping[j] = next("damping_" + joint, wrist ? 0.4 : 3, wrist ? 0.06 : 0.5, 0, 30);
    plan.integral[j] = next("integral_" + joint, wrist ? 10 : 50, wrist ? 2 : 8, 0, 300);
  }
  plan.hand_stiffness = next("hand_stiffness", 1.5, 0.3, 0, 20);
  plan.hand_damping = next("hand_damping", 0.03, 0.006, 0, 1);
  for (const bool closed : {false, true}) {
    std::array<double, kThumb + kFinger> hand{};
    for (size_t i = 0; i < hand.size(); ++i) {
      const Range& joint = kHand[i];
      const double start = closed && i >= kThumb ? joint.high / 2 : 0;
      hand[i] = next(std::string(closed ? "closed_" : "open_") + joint.name, start, 0.15, joint.low,
                     joint.high);
    }
    auto& to = closed ? plan.closed : plan.open;
    std::copy_n(hand.begin(), kThumb, to.begin());
    for (int f = 0; f < kFingers; ++f) {
      std::copy_n(hand.begin() + kThumb, kFinger, to.begin() + kThumb + f * kFinger);
    }
  }
  double time = 0;
  for (const Phase& phase : kPhases) {
    const std::string name = phase.name;
    time += next(name + "_time", 0.45, 0.08, 0.05, 4);
    WayPoint point;
    if (phase.stays) point = plan.way.back();
    point.time = time;
    point.grip = phase.grip;
    point.prosthesis = kAside;
    for (int j = 0; j < kCarrying && !phase.stays; ++j) {
      const Range& joint = kJoints[j];
      const std::string of = name + "_" + joint.name;
      point.arm[j][0] =
          next(of, std::clamp(0.5, joint.low, joint.high), 0.1, joint.low, joint.high);
      if (phase.depends == Depends::kNothing) continue;
      const size_t first = phase.depends == Depends::kOnStart ? 1 : 3;
      point.arm[j][first] = next(of + "_by_x", 0, 0.7, -kMostSlope, kMostSlope);
      point.arm[j][first + 1] = next(of + "_by_y", 0, 0.7, -kMostSlope, kMostSlope);
    }
    plan.way.push_back(point);
  }
  return plan;
}

struct Table {
  std::deque<std::string> names;  // which stay where they are, for `infos` points to them
  std::vector<ParameterInfo> infos;
};

const Table& Parameters() {
  static const Table table = [] {
    Table out;
    Walk([&out](const std::string& name, double start, double deviation, double low, double high) {
      out.names.push_back(name);
      out.infos.push_back({out.names.back().c_str(), start, deviation, low, high});
      return start;
    });
    return out;
  }();
  return table;
}

}  // namespace

std::span<const ParameterInfo> ReacherParameters() { return Parameters().infos; }

ReacherPlan MakePlan(std::span<const double> numbers) {
  size_t i = 0;
  return Walk([&](const std::string&, double, double, double, double) { return numbers[i++]; });
}

ReacherPlan ReadReacherPlan(const std::string& path) {
  return MakePlan(ReadNumbers(path, ReacherParameters()));
}

}  // namespace myograde::baseline
