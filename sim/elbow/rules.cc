#include "sim/elbow/rules.h"

#include <algorithm>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"

namespace myograde::sim {
namespace {

constexpr int64_t kMostElbowSteps = 1'000'000;
constexpr NumberRange kElbowTarget = {0, 2.5};       // the joint ends at 2.26893
constexpr NumberRange kElbowTolerance = {1e-4, 2.5};

void ReadTarget(ConfigReader& reader, ElbowRules& rules) {
  const std::vector<double> range = reader.Numbers("target_range_rad", 2, kElbowTarget);
  std::copy_n(range.begin(), std::min(range.size(), rules.target_range_rad.size()),
              rules.target_range_rad.begin());
  if (rules.target_range_rad[0] > rules.target_range_rad[1]) {
    reader.Fail("target_range_rad", "must be [low, high] with low <= high");
  }
}

void ReadHold(ConfigReader& reader, ElbowRules& rules) {
  rules.tolerance_rad = reader.Number("tolerance_rad", kElbowTolerance);
  rules.hold_steps = reader.Integer("hold_steps", 1, kMostElbowSteps);
  if (rules.hold_steps > rules.max_steps) {
    reader.Fail("hold_steps", absl::StrCat("must not be above max_steps (", rules.max_steps,
                                           "), or nobody could hold the target"));
  }
}

}  // namespace

absl::StatusOr<ElbowRules> ParseElbowRules(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  ElbowRules rules = {};
  ReadEpisodeRules(reader, rules);
  rules.end_rule = reader.Choice("end_rule", {"held", "time"}) == "held"
                       ? ElbowRules::EndRule::kHeld
                       : ElbowRules::EndRule::kTime;
  ReadTarget(reader, rules);
  ReadHold(reader, rules);
  rules.solved_distance_rad = reader.Number("solved_distance_rad", kElbowTolerance);
  if (auto status = reader.Finish(); !status.ok()) return status;
  return rules;
}

}  // namespace myograde::sim
