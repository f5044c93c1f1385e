// Environments for the tests of relocation.
#pragma once

#include <memory>
#include <vector>

#include "protocol/lease/track_config.h"
#include "sim/relocation/environment.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {

// The profile official of configs/tracks/relocation.json, its rules, and an environment of its
// own over them or others.
TrackConfig ObjectConfig();
RelocationRules ObjectRules();
std::unique_ptr<RelocationEnvironment> MakeObject(const RelocationRules& rules = ObjectRules());

std::vector<double> Rewards(const RelocationEnvironment& env);

// The measurements of the episode so far.
RelocationFacts FactsOf(const RelocationEnvironment& env);

}  // namespace myograde::sim
