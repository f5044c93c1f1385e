// The numbers that a search found, as policies/baseline/parameters/ keeps them.
#pragma once

#include <string>

#include "policies/baseline/walker_parameters.h"

namespace myograde::baseline {

// The walker's numbers in the JSON file `path`: every parameter by its name under "parameters",
// each within its range. std::runtime_error with one sentence if the file can't be read or isn't so.
WalkerNumbers ReadWalkerNumbers(const std::string& path);

}  // namespace myograde::baseline
