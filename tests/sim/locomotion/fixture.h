// What the locomotion tests share: the shipped rules and environments of them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "sim/locomotion/rules.h"
#include "sim/locomotion/environment.h"

namespace myograde::sim {

// The "rules" object of configs/tracks/locomotion.json in a profile.
nlohmann::json ShippedRules(const std::string& profile);
// Parsed; throws std::runtime_error with the parser's sentence.
LocomotionRules ParsedRules(const nlohmann::json& rules);

// Rules of the official environments by their names in golden files;
// `terrain` is their keyword argument, "" if not given.
LocomotionRules OfficialRules(const std::string& environment, const std::string& terrain = "");

// A new environment with the model of the cache. Throws std::runtime_error.
std::unique_ptr<LocomotionEnvironment> MakeEnvironment(const LocomotionRules& rules);

// The action of the golden files: sin(0.1 t + i) for the muscles, set 0.
std::vector<double> SineAction(int t);
// An official action (54 muscles, what follows is ignored) with parameter set 0.
std::vector<double> WithSetZero(std::vector<double> official);
// The same value for all muscles.
std::vector<double> ConstantAction(double muscles, double set = 0);

}  // namespace myograde::sim
