#include "sim/locomotion/rules_leg.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {

namespace {

// The joints' ranges, degrees.
constexpr NumberRange kKneeRange = {0, 120};
constexpr NumberRange kAnkleRange = {-30, 30};

struct QuantityKeys {
  const char* above;
  const char* below;
  NumberRange range;
};
constexpr std::array<QuantityKeys, kLegQuantities> kQuantities = {{
    {"load_above", "load_below", {0, 10}},
    {"knee_deg_above", "knee_deg_below", {-360, 360}},
    {"knee_deg_s_above", "knee_deg_s_below", {-10000, 10000}},
    {"ankle_deg_above", "ankle_deg_below", {-360, 360}},
    {"ankle_deg_s_above", "ankle_deg_s_below", {-10000, 10000}},
}};

// Reads nested objects and keeps the first mistake of all of them. An object that is missing
// is told by its own reader, so its parts are not asked for.
class SetReader {
 public:
  explicit SetReader(const LegRules& limits) : limits_(limits) {}

  LegSetRules Set(const nlohmann::json& json, const std::string& where) {
    LegSetRules set;
    ConfigReader reader(json, where);
    set.name = reader.String("name");
    std::array<const nlohmann::json*, kLegStates> states = {};
    for (int i = 0; i < kLegStates; ++i) states[i] = &reader.Object(kLegStateKeys[i]);
    if (!Done(reader)) return set;
    for (int i = 0; i < kLegStates; ++i) {
      set.states[i] = State(*states[i], absl::StrCat(where, ".", kLegStateKeys[i]));
    }
    return set;
  }
  const absl::Status& status() const { return status_; }

 private:
  bool Done(ConfigReader& reader) {
    const absl::Status status = reader.Finish();
    if (status_.ok()) status_ = status;
    return status.ok();
  }

  LegStateRules State(const nlohmann::json& json, const std::string& where) {
    LegStateRules state;
    ConfigReader reader(json, where);
    const nlohmann::json& knee = reader.Object("knee");
    const nlohmann::json& ankle = reader.Object("ankle");
    const nlohmann::json& until = reader.Object("until");
    if (!Done(reader)) return state;
    state.knee = Joint(knee, where + ".knee", kKneeRange);
    state.ankle = Joint(ankle, where + ".ankle", kAnkleRange);
    state.until = Until(until, where + ".until");
    return state;
  }

  JointImpedance Joint(const nlohmann::json& json, const std::string& where, NumberRange range) {
    ConfigReader reader(json, where);
    JointImpedance joint;
    joint.stiffness = reader.Number("stiffness", {0, limits_.max_stiffness});
    joint.damping = reader.Number("damping", {0, limits_.max_damping});
    joint.target_deg = reader.Number("target_deg", range);
    Done(reader);
    return joint;
  }

  std::array<LegThreshold, kLegQuantities> Until(const nlohmann::json& json,
                                                 const std::string& where) {
    ConfigReader reader(json, where);
    std::array<LegThreshold, kLegQuantities> until;
    bool any = false;
    for (int q = 0; q < kLegQuantities; ++q) {
      const QuantityKeys& keys = kQuantities[q];
      const bool above = reader.Has(keys.above);
      const bool below = reader.Has(keys.below);
      if (above && below) {
        reader.Fail(keys.above, absl::StrCat("and \"", keys.below, "\" can't both be there"));
      }
      if (above) until[q] = {ThresholdKind::kAbove, reader.Number(keys.above, keys.range)};
      if (below) until[q] = {ThresholdKind::kBelow, reader.Number(keys.below, keys.range)};
      any = any || above || below;
    }
    if (!any) reader.Fail("load_above", "or another condition to leave the state must be given");
    Done(reader);
    return until;
  }

  const LegRules& limits_;
  absl::Status status_;
};

}  // namespace

absl::StatusOr<LegRules> ParseLegRules(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  LegRules leg;
  leg.sets = static_cast<int>(reader.Integer("sets", 1, kLegSets));
  leg.full_torque = reader.Boolean("full_torque");
  leg.max_stiffness = reader.Number("max_stiffness", {1, 1e6});
  leg.max_damping = reader.Number("max_damping", {1, 1e6});
  const nlohmann::json& sets = reader.Array("parameter_sets");
  if (!sets.empty() && std::ssize(sets) != leg.sets) {
    reader.Fail("parameter_sets",
                absl::StrCat("has ", sets.size(), " entries, must have one for each of the ",
                             leg.sets, " sets, or none"));
  }
  RETURN_IF_ERROR(reader.Finish());
  SetReader set_reader(leg);
  for (size_t i = 0; i < sets.size(); ++i) {
    leg.parameter_sets.push_back(
        set_reader.Set(sets[i], absl::StrCat(where, ".parameter_sets[", i, "]")));
  }
  if (!set_reader.status().ok()) return set_reader.status();
  return leg;
}

}  // namespace myograde
