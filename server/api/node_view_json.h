// The nodes of a cluster, as the executor and the store know them, for an answer.
#pragma once

#include <vector>

#include <nlohmann/json.hpp>

#include "server/executor/executor.h"
#include "server/store/rows.h"

namespace myograde::server {

// By name: what the executor knows, and what the store has as drained, though the executor has not
// met it; without a cluster only the former.
nlohmann::json NodesToJson(const std::vector<NodeView>& known,
                           const std::vector<DrainedNodeRow>& drained, bool remote);

}  // namespace myograde::server
