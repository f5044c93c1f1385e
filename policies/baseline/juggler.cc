#include "policies/baseline/juggler.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <string>
#include <utility>

namespace myograde::baseline {
namespace {

constexpr double kWholeTurn = 0.5;  // rad: from here on the balls are turned as fast as they can be
constexpr double kLength = 0.01;    // m, the unit of places
constexpr double kMost = 3;         // of a feature
constexpr size_t kBall1 = 23, kBall2 = 29, kTarget1 = 35, kTarget2 = 38, kHandActivations = 47;

constexpr std::array<const char*, kHandAngles> kHandJointNames = {
    "pronation",        "deviation",     "wrist",      "thumb_abduction",
    "thumb_flexion",    "thumb_middle",  "thumb_tip",  "index_base",
    "index_abduction",  "index_middle",  "index_tip",  "middle_base",
    "middle_abduction", "middle_middle", "middle_tip", "ring_base",
    "ring_abduction",   "ring_middle",   "ring_tip",   "little_base",
    "little_abduction", "little_middle", "little_tip"};

// What a feature moves.
constexpr std::array<JointGroup, 9> kGroups = {{{"deviation", 1},
                                                {"wrist", 2},
                                                {"thumb_abduction", 3},
                                                {"thumb_flexion", 4},
                                                {"thumb_bend", 5, 6, 7, 0.5},
                                                {"index", 7, 9, 11, 0.5},
                                                {"middle", 11, 13, 15, 0.5},
                                                {"ring", 15, 17, 19, 0.5},
                                                {"little", 19, 21, 23, 0.5}}};

// The double angle at which the balls lie, as they are alike; how far they have to be turned around
// each other, also times that; how far their middle is from where it should be. Each is about 1 at
// most.
constexpr std::array<const char*, 7> kFeatures = {"lie_cos",  "lie_sin", "turn", "turn_cos",
                                                  "turn_sin", "x",       "y"};

std::array<double, kFeatures.size()> FeaturesOf(
    std::span<const double, kJugglerObservation> observation) {
  const auto place = [&](size_t at) {
    return Eigen::Vector2d(observation[at], observation[at + 1]);
  };
  const Eigen::Vector2d first = place(kBall1), second = place(kBall2);
  const Eigen::Vector2d target1 = place(kTarget1), target2 = place(kTarget2);
  const Eigen::Vector2d balls = first - second, targets = target1 - target2;
  const Eigen::Vector2d missing = (target1 + target2 - first - second) / 2 / kLength;
  const double lie = std::atan2(balls.y(), balls.x());
  const double way = std::remainder(std::atan2(targets.y(), targets.x()) - lie, 2 * M_PI);
  const double turn = std::tanh(way / kWholeTurn);
  const double c = std::cos(2 * lie), s = std::sin(2 * lie);
  return {c, s, turn, turn * c, turn * s, missing.x(), missing.y()};
}

}  // namespace

std::span<const ParameterInfo> JugglerParameters() {
  static std::deque<std::string> names;  // which the infos point into
  static const std::vector<ParameterInfo> infos = [] {
    std::vector<ParameterInfo> made;
    const auto add = [&](std::string name, double start, double deviation) {
      const char* kept = names.emplace_back(std::move(name)).c_str();
      made.push_back({kept, start, deviation, -2, 2});
    };
    for (size_t j = 0; j < kHandAngles; ++j) add(kHandJointNames[j], kCuppedHand[j], 0.15);
    for (const char* feature : kFeatures) {
      for (const JointGroup& group : kGroups) add(std::string(feature) + "_" + group.name, 0, 0.1);
    }
    return made;
  }();
  return infos;
}

void Juggler::Act(std::span<const double, kJugglerObservation> observation,
                  std::span<double, kHandActions> action) {
  HandPosture target;
  std::copy_n(numbers_.begin(), kHandAngles, target.begin());
  auto number = numbers_.begin() + kHandAngles;
  for (const double feature : FeaturesOf(observation)) {
    for (const JointGroup& group : kGroups) {
      group.Move(std::clamp(feature, -kMost, kMost) * *number++, target);
    }
  }
  hand_.Follow(observation.first<kHandAngles>(),
               observation.subspan<kHandActivations, kHandActions>(), target, action);
}

}  // namespace myograde::baseline
