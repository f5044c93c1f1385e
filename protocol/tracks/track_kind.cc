#include "protocol/tracks/track_kind.h"

#include "protocol/base/config_reader.h"

namespace myograde {

absl::StatusOr<int64_t> MaxStepsKey(const nlohmann::json& rules) {
  ConfigReader reader(rules, "rules");
  const int64_t steps = reader.Integer("max_steps", 1, 1'000'000);
  if (!reader.mistake().ok()) return reader.mistake();
  return steps;
}

}  // namespace myograde
