// A walker on the graded course.
#pragma once

#include <memory>
#include <vector>

#include "policies/baseline/walker.h"
#include "sim/locomotion/locomotion.h"

namespace myograde::baseline {

// The walker with the numbers of policies/baseline/parameters.
Walker ShippedWalker();

// The course of the profile `paper` with the walker's leg sets and direct actions.
std::unique_ptr<sim::Locomotion> CourseFor(const Walker& walker);

// Plays up to `steps` steps of the episode `seed` and returns its actions, one after the other.
std::vector<double> Walk(sim::Locomotion& course, Walker& walker, uint64_t seed, int steps);

}  // namespace myograde::baseline
