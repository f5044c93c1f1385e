#include "policies/baseline/tagger.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <string_view>

namespace myograde::baseline {
namespace {

constexpr size_t kOpponent = 64, kOpponentSpeed = 67, kRoot = 69,
                 kRootVelocity = 71;  // in the observation
// m/s: no opponent is faster, and one that is chased is only so fast by its own will.
constexpr double kFastest = 2, kRepelled = 1;

// Beyond the walker's.
enum Own : size_t {
  kAhead,     // s, of the opponent's way, by which the chaser aims ahead of it
  kEdge,      // m from the middle, where an evader drops
  kTurnRate,  // rad/s, that the heading follows what is wanted
  kBegun,     // s, that the first swing has lasted
  kOwnCount
};
constexpr std::array<ParameterInfo, kOwnCount> kOwn = {{{"ahead", 0.3, 0.3, 0, 3},
                                                        {"edge", 5.7, 0.15, 4.5, 6.4},
                                                        {"turn_rate", 0.5, 0.2, 0, 3},
                                                        {"begun", 0.1, 0.05, 0, 0.4}}};

// Only a prosthetic leg, the middle of a course or its height map has these.
bool OfTheCourse(std::string_view name) {
  constexpr std::string_view kOthers[] = {"steering", "line",       "turn_bias",  "drift",
                                          "crab",     "swing_lead", "swing_early"};
  return name.starts_with("leg_") || name.starts_with("rise_") ||
         std::ranges::find(kOthers, name) != std::end(kOthers);
}

// Where TaggerParameters() has each of the walker's numbers; -1 where it has none.
const std::array<int, kWalkerParameterCount>& Places() {
  static const std::array<int, kWalkerParameterCount> places = [] {
    std::array<int, kWalkerParameterCount> made{};
    int next = 0;
    for (size_t i = 0; i < made.size(); ++i) {
      const std::string_view name = kWalkerParameters[i].name;
      // Each right one comes right after its left one.
      made[i] = OfTheCourse(name) ? -1 : name.ends_with("_right") ? next - 1 : next++;
    }
    return made;
  }();
  return places;
}

WalkerNumbers WholeNumbers(std::span<const double> numbers) {
  WalkerNumbers whole{};
  for (size_t i = 0; i < whole.size(); ++i) {
    if (Places()[i] >= 0) whole[i] = numbers[static_cast<size_t>(Places()[i])];
  }
  whole[kRollRight] = -whole[kRollLeft];
  return whole;
}

}  // namespace

std::span<const ParameterInfo> TaggerParameters() {
  static const std::vector<ParameterInfo> infos = [] {
    std::vector<ParameterInfo> made;
    for (size_t i = 0; i < kWalkerParameters.size(); ++i) {
      if (Places()[i] == static_cast<int>(made.size())) made.push_back(kWalkerParameters[i]);
    }
    made.insert(made.end(), kOwn.begin(), kOwn.end());
    return made;
  }();
  return infos;
}

Tagger::Tagger(std::span<const double> numbers)
    : own_(numbers.end() - kOwnCount, numbers.end()),
      walker_(WholeNumbers(numbers), Legs::kWhole, own_[kBegun]) {}

void Tagger::Reset() {
  walker_.Reset();
  seen_ = 0;
  evades_ = false;
}

// The observation does not tell the task. An opponent that chases wants one speed all the time,
// drawn from 1 m/s on; the others stand, waver, or are at a limit of their speed.
void Tagger::SeeTask(double speed) {
  if (++seen_ == 3) evades_ = speed == speed_ && speed > kRepelled && speed != kFastest;
  speed_ = speed;
}

double Tagger::Heading(std::span<const double, kWholeObservation> observation) const {
  const double x = observation[kRoot], y = observation[kRoot + 1];
  // It starts along its heading, and the first observation need not show the opponent.
  if (seen_ == 1) return std::atan2(observation[kRootVelocity + 1], observation[kRootVelocity]);
  if (evades_) {
    return std::abs(x) > std::abs(y) ? std::atan2(0, x) : std::atan2(y, 0);
  }
  const double angle = observation[kOpponent + 2];
  const double way = own_[kAhead] * std::min(observation[kOpponentSpeed], kFastest);
  return std::atan2(observation[kOpponent + 1] - way * std::cos(angle) - y,
                    observation[kOpponent] + way * std::sin(angle) - x);
}

void Tagger::Act(std::span<const double, kWholeObservation> observation,
                 std::span<double, kWholeMuscles> action) {
  const double away = std::max(std::abs(observation[kRoot]), std::abs(observation[kRoot + 1]));
  SeeTask(observation[kOpponentSpeed]);
  const double wanted = Heading(observation);
  const double most = own_[kTurnRate] * kWholeControlStep;
  heading_ =
      seen_ == 1 ? wanted : Wrapped(heading_ + std::clamp(Wrapped(wanted - heading_), -most, most));
  if (evades_ && away > own_[kEdge]) {
    std::ranges::fill(action, 0.0);
  } else {
    walker_.Act(observation.first<kWholeObservation>(), heading_, action);
  }
}

}  // namespace myograde::baseline
