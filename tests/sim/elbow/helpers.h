// Environments and states for the tests of the elbow track.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"
#include "sim/elbow/environment.h"

namespace myograde::sim {

// A profile of configs/tracks/elbow.json, and its rules.
TrackConfig ElbowConfig(const std::string& profile);
ElbowRules ElbowRulesOf(const std::string& profile);

// An environment of its own over these rules.
std::unique_ptr<ElbowEnvironment> MakeElbowWith(const ElbowRules& rules);
std::unique_ptr<ElbowEnvironment> MakeElbowProfile(const std::string& profile);

// The measurements of the episode so far.
ElbowFacts FactsOf(const ElbowEnvironment& env);

// Puts the elbow at `angle` (rad) at rest and brings everything up to date.
void PutElbow(ElbowEnvironment& env, double angle);

// Loads a recorded state (time, qpos, qvel, act, ctrl, and qacc as warm start).
void LoadRecorded(ElbowEnvironment& env, const nlohmann::json& state);

}  // namespace myograde::sim
