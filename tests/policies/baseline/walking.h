// A walker on the graded course.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "policies/baseline/walker.h"
#include "sim/locomotion/environment.h"

namespace myograde::baseline {

// The walker with the numbers of policies/baseline/parameters, in this profile.
Walker ShippedWalker(const std::string& profile = "paper");

// The course of these rules (ShippedRules) with direct actions.
std::unique_ptr<sim::LocomotionEnvironment> CourseOf(const nlohmann::json& rules);
std::unique_ptr<sim::LocomotionEnvironment> PaperCourse();

// Uploads the walker's sets of the leg, plays up to `steps` steps of the episode `seed` and returns
// its actions, one after the other.
std::vector<double> Walk(sim::LocomotionEnvironment& course, Walker& walker, uint64_t seed, int steps);

}  // namespace myograde::baseline
