#include "protocol/bridge/leg_sets_json.h"

#include <cfloat>
#include <string>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

constexpr NumberRange kFinite = {-DBL_MAX, DBL_MAX};

Json StateToJson(const LegStateParameters& state) {
  Json kinds = Json::array();
  Json values = Json::array();
  for (int i = 0; i < kLegQuantities; ++i) {
    kinds.push_back(state.threshold_kind[i]);
    values.push_back(state.threshold[i]);
  }
  return {{"knee", {state.knee_stiffness, state.knee_damping, state.knee_target}},
          {"ankle", {state.ankle_stiffness, state.ankle_damping, state.ankle_target}},
          {"threshold_kinds", kinds},
          {"thresholds", values}};
}

absl::Status ReadState(const Json& json, const std::string& where, LegStateParameters& state) {
  ConfigReader reader(json, where);
  const std::vector<double> knee = reader.Numbers("knee", 3, kFinite);
  const std::vector<double> ankle = reader.Numbers("ankle", 3, kFinite);
  const std::vector<double> kinds = reader.Numbers("threshold_kinds", kLegQuantities, {0, 2});
  const std::vector<double> values = reader.Numbers("thresholds", kLegQuantities, kFinite);
  RETURN_IF_ERROR(reader.Finish());
  state.knee_stiffness = knee[0];
  state.knee_damping = knee[1];
  state.knee_target = knee[2];
  state.ankle_stiffness = ankle[0];
  state.ankle_damping = ankle[1];
  state.ankle_target = ankle[2];
  for (size_t i = 0; i < kLegQuantities; ++i) {
    state.threshold_kind[i] = static_cast<uint8_t>(kinds[i]);
    state.threshold[i] = values[i];
  }
  return absl::OkStatus();
}

}  // namespace

nlohmann::json LegSetsToJson(const LegParameterSets& sets) {
  Json json = Json::object();
  for (uint32_t i = 0; i < kLegSets; ++i) {
    if ((sets.present >> i & 1u) == 0) continue;
    Json states = Json::array();
    for (const LegStateParameters& state : sets.set[i]) states.push_back(StateToJson(state));
    json[std::to_string(i)] = std::move(states);
  }
  return json;
}

absl::StatusOr<LegParameterSets> LegSetsFromJson(const nlohmann::json& json) {
  const absl::Status bad = absl::InvalidArgumentError(
      "\"leg_sets\" must be an object of parameter sets \"0\" to \"4\" with four states each");
  if (!json.is_object()) return bad;
  LegParameterSets sets = {};
  for (const auto& [name, states] : json.items()) {
    uint32_t number = 0;
    if (!absl::SimpleAtoi(name, &number) || number >= kLegSets || name != std::to_string(number) ||
        !states.is_array() || states.size() != kLegStates) {
      return bad;
    }
    sets.present |= 1u << number;
    for (size_t i = 0; i < kLegStates; ++i) {
      const std::string where = absl::StrCat("leg set ", number, ", state ", i);
      RETURN_IF_ERROR(ReadState(states[i], where, sets.set[number][i]));
    }
  }
  return sets;
}

}  // namespace myograde
