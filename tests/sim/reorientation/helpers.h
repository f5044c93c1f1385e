// Environments for the tests of die reorientation.
#pragma once

#include <memory>
#include <vector>

#include "protocol/lease/track_config.h"
#include "sim/reorientation/environment.h"
#include "tests/sim/hand_golden.h"

namespace myograde::sim {

// The profile official of configs/tracks/reorientation.json, its rules, and an environment of its
// own over them or others.
TrackConfig DieConfig();
ReorientationRules DieRules();
std::unique_ptr<ReorientationEnvironment> MakeDie(const ReorientationRules& rules = DieRules());

std::vector<double> Rewards(const ReorientationEnvironment& env);

// The measurements of the episode so far.
ReorientationFacts FactsOf(const ReorientationEnvironment& env);

}  // namespace myograde::sim
