#include "tests/sim/locomotion/fixture.h"

#include <cmath>
#include <stdexcept>

#include "protocol/lease/track_config.h"
#include "sim/locomotion/track.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

template <typename T>
T Get(absl::StatusOr<T> value) {
  if (!value.ok()) throw std::runtime_error(std::string(value.status().message()));
  return *std::move(value);
}

}  // namespace

nlohmann::json ShippedRules(const std::string& profile) {
  return Get(LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "locomotion", profile)).rules;
}

LocomotionRules ParsedRules(const nlohmann::json& rules) {
  return Get(ParseLocomotionRules(rules, "rules"));
}

LocomotionRules OfficialRules(const std::string& environment, const std::string& terrain) {
  nlohmann::json rules = ShippedRules("myosuite");
  if (environment.find("Fixed") != std::string::npos) {
    rules["course"]["kinds"] = {"flat"};
    rules["start"]["y_m"] = 15;
    rules["end"]["distance_from_y_m"] = 14;
    rules["end"]["finish_y_m"] = -15;
    rules["end"]["time_limit_s"] = 5;
  }
  if (terrain == "flat") rules["course"]["kinds"] = {"flat"};
  if (terrain == "random_mixed") rules["course"]["kinds"] = {"mixed"};
  return ParsedRules(rules);
}

std::unique_ptr<LocomotionEnvironment> MakeEnvironment(const LocomotionRules& rules) {
  return Get(LocomotionEnvironment::Make(rules, Get(LoadModel(LocomotionModel(), CacheDir()))));
}

std::vector<double> SineAction(int t) {
  std::vector<double> action(LocomotionEnvironment::kActionSize, 0.0);
  for (int i = 0; i < kLegMuscles; ++i) action[i] = std::sin(0.1 * t + i);
  return action;
}

std::vector<double> WithSetZero(std::vector<double> official) {
  official.resize(kLegMuscles);
  official.push_back(0);
  return official;
}

std::vector<double> ConstantAction(double muscles, double set) {
  std::vector<double> action(LocomotionEnvironment::kActionSize, muscles);
  action.back() = set;
  return action;
}

}  // namespace myograde::sim
