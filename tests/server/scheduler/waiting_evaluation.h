// What the scheduler's tests add to it.
#pragma once

#include <absl/time/time.h>

#include <cstdint>
#include <string>

#include "server/scheduler/scheduler.h"

namespace myograde::server {

// An evaluation of `blocks` blocks, whose numbers begin with 1000 times its own. `lease_wall`: the
// longest run of a lease before it is reclaimed.
inline EvaluationSpec WaitingEvaluation(int64_t id, const std::string& team, int blocks,
                                        Priority priority = Priority::kRanked,
                                        absl::Duration lease_wall = absl::Seconds(100)) {
  EvaluationSpec spec{id, team, "", priority, lease_wall, {}};
  for (int i = 0; i < blocks; ++i) spec.blocks.push_back({id * 1000 + i, 0, 0});
  return spec;
}

}  // namespace myograde::server
