// The prosthetic leg's parameter sets as JSON, between what decodes a policy's messages and the track.
#pragma once

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/policy/leg_parameters.h"

namespace myograde {

// An object of the sets that are present, by number ("0" to "4"). Each is a list of its four states
// with `knee` and `ankle` (stiffness, damping, target), and `threshold_kinds` and `thresholds` (one per
// quantity).
nlohmann::json LegSetsToJson(const LegParameterSets& sets);
// InvalidArgumentError: which set, state and number is wrong, and how.
absl::StatusOr<LegParameterSets> LegSetsFromJson(const nlohmann::json& json);

}  // namespace myograde
