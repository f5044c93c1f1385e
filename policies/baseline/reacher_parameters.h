// The numbers of the reacher and of the carrier that a search may change, by name, and the plans
// that they make.
#pragma once

#include <span>
#include <string>

#include "policies/baseline/carrier.h"
#include "policies/baseline/reacher.h"
#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

// Angles in rad, times in s, places in m; gains in N m/rad, N m s/rad and N m/(rad s).
std::span<const ParameterInfo> ReacherParameters();
std::span<const ParameterInfo> CarrierParameters();

// The plan of `numbers`, which stand in the order of ReacherParameters() or CarrierParameters().
ReacherPlan MakePlan(std::span<const double> numbers);
CarrierPlan MakeCarrierPlan(std::span<const double> numbers);

// The plan in the JSON file `path`, as ReadNumbers reads it (parameter_file.h).
ReacherPlan ReadReacherPlan(const std::string& path);

}  // namespace myograde::baseline
