// Environments and states for the tests of the manipulation track.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "sim/manipulation/rules.h"
#include "sim/manipulation/environment.h"

namespace myograde::sim {

// The rules of a profile of configs/tracks/manipulation.json.
ManipulationRules RulesOf(const std::string& profile);

// An environment of its own over these rules.
std::unique_ptr<ManipulationEnvironment> MakeEnvironmentWith(const ManipulationRules& rules);
std::unique_ptr<ManipulationEnvironment> MakeProfile(const std::string& profile);

// The model's actuators in the official order (muscles first) and back.
std::vector<double> OfficialControls(ManipulationEnvironment& env);

// Loads a recorded state (time, qpos, qvel, act, ctrl, and as warm start
// "qacc_warmstart" or "qacc") into the environment's data.
void LoadRecordedState(ManipulationEnvironment& env, const nlohmann::json& state);

// The 210 entries of the official vector, taken from the 222 observations.
std::vector<double> OfficialObservation(const ManipulationEnvironment& env);

// True if a mesh is in contact with anything: contacts of convex meshes are what the two
// versions of MuJoCo choose differently, be it with the object's box, with a hand or with
// another mesh.
bool AnyMeshTouches(ManipulationEnvironment& env);

// True if anything at all touches the object.
bool AnythingTouchesObject(const ManipulationEnvironment& env);

// Puts the object at `place` (upright as in the keyframe) and brings everything up to date.
void PutObject(ManipulationEnvironment& env, const Eigen::Vector3d& place);

}  // namespace myograde::sim
