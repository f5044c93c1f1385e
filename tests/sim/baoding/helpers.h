// Environments for the tests of Baoding balls.
#pragma once

#include <memory>
#include <vector>

#include "protocol/lease/track_config.h"
#include "sim/baoding/environment.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {

// The profile official of configs/tracks/baoding.json, its rules, and an environment of its own
// over them or others.
TrackConfig BallsConfig();
BaodingRules BallsRules();
std::unique_ptr<BaodingEnvironment> MakeBalls(const BaodingRules& rules = BallsRules());

std::vector<double> Rewards(const BaodingEnvironment& env);

// The measurements of the episode so far.
BaodingFacts FactsOf(const BaodingEnvironment& env);

}  // namespace myograde::sim
