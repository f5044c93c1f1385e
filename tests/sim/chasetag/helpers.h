// Environments for the tests of chase-tag.
#pragma once

#include <memory>
#include <vector>

#include "protocol/lease/track_config.h"
#include "sim/chasetag/environment.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {

// The profile official of configs/tracks/chasetag.json, its rules, and an environment of its own
// over them or others.
TrackConfig ChaseConfig();
ChaseTagRules ChaseRules();
std::unique_ptr<ChaseTagEnvironment> MakeChase(const ChaseTagRules& rules = ChaseRules());

std::vector<double> Rewards(const ChaseTagEnvironment& env);

// The measurements of the episode so far.
ChaseTagFacts FactsOf(const ChaseTagEnvironment& env);

}  // namespace myograde::sim
