// The prosthetic leg's parameter sets as JSON, for the logs of episodes.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/policy/layout.h"
#include "protocol/policy/leg_parameters.h"

namespace myograde {

// An object of the sets that are present, by number ("0" to "4"). Each is a list of its four states
// with `knee` and `ankle` (stiffness, damping, target) and `thresholds` (pairs of kind and value,
// one per quantity).
nlohmann::json LegSetsToJson(const LegParameterSets& sets);
absl::StatusOr<LegParameterSets> LegSetsFromJson(const nlohmann::json& json);

}  // namespace myograde
