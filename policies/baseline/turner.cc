#include "policies/baseline/turner.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace myograde::baseline {
namespace {

constexpr size_t kMissing = 51, kGoalRotation = 57, kTurnerActivations = 63;
constexpr int kSeenAngles = 22;  // observed: all but the last joint of the little finger
// How far from an outcome its promise falls by exp(-1/2).
constexpr double kRotationWidth = 0.2, kPlaceWidth = 0.015;  // rad, m

struct TurnGroup {
  JointGroup joints;
  double deviation;  // rad, of the search's first postures
};
constexpr std::array<TurnGroup, 16> kTurnGroups = {{{{"pronation", 0}, 0.3},
                                                    {{"deviation", 1}, 0.2},
                                                    {{"wrist", 2}, 0.4},
                                                    {{"thumb_abduction", 3}, 0.3},
                                                    {{"thumb_flexion", 4}, 0.3},
                                                    {{"thumb_bend", 5, 6, 7, 0.5}, 0.4},
                                                    {{"index", 7}, 0.4},
                                                    {{"index_bend", 9, 10, 11, 0.7}, 0.5},
                                                    {{"middle", 11}, 0.4},
                                                    {{"middle_bend", 13, 14, 15, 0.7}, 0.5},
                                                    {{"ring", 15}, 0.4},
                                                    {{"ring_bend", 17, 18, 19, 0.7}, 0.5},
                                                    {{"little", 19}, 0.4},
                                                    {{"little_bend", 21, 22, 23, 0.7}, 0.5},
                                                    {{"index_abduction", 8}, 0.15},
                                                    {{"little_abduction", 20}, 0.15}}};

double SquaredDistance(std::span<const double, 3> a, std::span<const double, 3> b) {
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

}  // namespace

double Turn::Promise(std::span<const double, 3> rotation, std::span<const double, 3> place) const {
  double most = 0;
  for (const Outcome& outcome : outcomes) {
    const double away =
        SquaredDistance(rotation, outcome.rotation) / (kRotationWidth * kRotationWidth) +
        SquaredDistance(place, outcome.place) / (kPlaceWidth * kPlaceWidth);
    most = std::max(most, outcome.share * std::exp(-away / 2));
  }
  return most;
}

std::span<const ParameterInfo> TurnParameters() {
  static std::deque<std::string> names;  // which the infos point into
  static const std::vector<ParameterInfo> infos = [] {
    std::vector<ParameterInfo> made = {{"second_begins", 30, 10, 1, 149},
                                       {"third_begins", 70, 12, 1, 149},
                                       {"fourth_begins", 105, 12, 1, 149}};
    for (const char* posture : {"first", "second", "third", "fourth"}) {
      for (const TurnGroup& group : kTurnGroups) {
        const std::string& name =
            names.emplace_back(std::string(posture) + "_" + group.joints.name);
        made.push_back({name.c_str(), 0, group.deviation, -3, 3});
      }
    }
    return made;
  }();
  return infos;
}

Turn MakeTurn(std::span<const double> numbers) {
  Turn turn;
  auto number = numbers.begin();
  for (size_t i = 1; i < turn.begins.size(); ++i) turn.begins[i] = static_cast<int>(*number++);
  for (HandPosture& posture : turn.postures) {
    posture = kCuppedHand;
    for (const TurnGroup& group : kTurnGroups) group.joints.Move(*number++, posture);
  }
  return turn;
}

std::vector<Turn> ReadTurns(const std::string& path) {
  std::ifstream file(path);
  std::vector<Turn> turns;
  try {
    const nlohmann::json content = nlohmann::json::parse(file);
    for (const nlohmann::json& item : content.at("turns")) {
      auto numbers = item.at("begins").get<std::vector<double>>();
      for (const nlohmann::json& posture : item.at("postures")) {
        const auto angles = posture.get<std::array<double, kTurnGroups.size()>>();
        numbers.insert(numbers.end(), angles.begin(), angles.end());
      }
      if (numbers.size() != TurnParameters().size()) {
        throw std::runtime_error("turns have three begins and four postures");
      }
      Turn& turn = turns.emplace_back(MakeTurn(numbers));
      for (const auto& outcome : item.at("outcomes").get<std::vector<std::array<double, 7>>>()) {
        Turn::Outcome& added = turn.outcomes.emplace_back();
        std::copy_n(outcome.begin(), 3, added.rotation.begin());
        std::copy_n(outcome.begin() + 3, 3, added.place.begin());
        added.share = outcome.back();
      }
    }
    if (turns.empty()) throw std::runtime_error("it has no turns");
  } catch (const std::exception& error) {
    throw std::runtime_error(path + " is not a file of turns: " + error.what() + ".");
  }
  return turns;
}

void Turner::Reset() {
  hand_.Reset();
  turn_ = nullptr;
  step_ = 0;
}

void Turner::Act(std::span<const double, kTurnerObservation> observation,
                 std::span<double, kHandActions> action) {
  if (turn_ == nullptr) {
    const auto rotation = observation.subspan<kGoalRotation, 3>();
    const auto place = observation.subspan<kMissing, 3>();
    turn_ = &*std::ranges::max_element(
        turns_, {}, [&](const Turn& turn) { return turn.Promise(rotation, place); });
  }
  std::array<double, kHandAngles> angles{};
  std::copy_n(observation.begin(), kSeenAngles, angles.begin());
  angles[kSeenAngles] = angles[kSeenAngles - 1];  // a finger's last joint follows the one before
  const auto next = std::ranges::upper_bound(turn_->begins, step_++);
  hand_.Follow(angles, observation.subspan<kTurnerActivations, kHandActions>(),
               turn_->postures[static_cast<size_t>(next - turn_->begins.begin()) - 1], action);
}

}  // namespace myograde::baseline
