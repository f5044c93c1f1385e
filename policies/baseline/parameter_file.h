// The numbers that a search found, as policies/baseline/parameters/ keeps them.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

// The numbers in the JSON file `path`: every parameter of `infos` by its name under "parameters",
// each within its range, in the order of `infos`. std::runtime_error with one sentence if the file
// can't be read or isn't so.
std::vector<double> ReadNumbers(const std::string& path, std::span<const ParameterInfo> infos);

// The walker's numbers in the file `path`, as ReadNumbers reads them.
WalkerNumbers ReadWalkerNumbers(const std::string& path);

}  // namespace myograde::baseline
