// What a lease used beside its episodes. Pure.
#pragma once

#include <cstdint>
#include <vector>

#include <nlohmann/json.hpp>

#include "server/store/rows.h"

namespace myograde::server {

// Adds to the JSON of what a lease used (`policy_cpu_s`, `wall_s`; s) the parts outside of its
// episodes, `startup_cpu_s` and `startup_wall_s`: the policy's start, until it was ready for its
// first episode (of all starts, if it was started again), and its end. The rows of its episodes,
// `first` to `last`, are among `rows`.
void AddStartUp(const std::vector<EpisodeRow>& rows, int64_t first, int64_t last, nlohmann::json& use);

}  // namespace myograde::server
