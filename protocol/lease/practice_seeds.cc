#include "protocol/lease/practice_seeds.h"

namespace myograde {

std::vector<uint64_t> DefaultPracticeSeeds(const std::set<uint64_t>& ranked, int64_t count) {
  constexpr uint64_t kLargest = INT64_MAX;
  std::vector<uint64_t> seeds;
  uint64_t next = ranked.empty() ? 0 : *ranked.rbegin() + 1;
  while (std::ssize(seeds) < count && next <= kLargest) seeds.push_back(next++);
  for (next = 0; std::ssize(seeds) < count; ++next) {
    if (!ranked.contains(next)) seeds.push_back(next);
  }
  return seeds;
}

}  // namespace myograde
