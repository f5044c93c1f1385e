// How often a test program has allocated with new: link allocations.cc to count.
#pragma once

#include <cstdint>

namespace myograde::sim {

int64_t Allocations();

}  // namespace myograde::sim
