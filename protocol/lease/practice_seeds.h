// The seeds that practice plays. They are no part of what a result is a function of: a config's
// hash does not cover them.
#pragma once

#include <cstdint>
#include <set>
#include <vector>

namespace myograde {

// `count` seeds for a track whose config names none: from the largest of `ranked` + 1 on, and once
// 2^63 - 1 is reached, the smallest that are not in `ranked`.
std::vector<uint64_t> DefaultPracticeSeeds(const std::set<uint64_t>& ranked, int64_t count);

}  // namespace myograde
