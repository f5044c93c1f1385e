// Which of its submissions each team stands with on a board whose bands depend on who stands.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace myograde::scoring {

// A submission that takes part in a board's bands.
struct BandCandidate {
  size_t team = 0;         // any number that tells teams apart
  int64_t acceptance = 0;  // unique
  double value = 0;        // what opens a band
  size_t inside = 0;       // its place in the order inside a band, unique among all candidates
};

// The places in `candidates` of the submissions that the teams stand with, one of each team, in
// ascending order. `candidates`: in the order in which bands are cut. `belongs(value, opener)`: whether
// a later candidate belongs to the band that one with `opener` opened.
//
// Submissions count in the order of their acceptance. With each, its team takes the entry that ranks
// best among the entries of the other teams; of equal ranks the one that is first on a board of the
// team's own submissions. Then all teams, in the order of their first submissions, exchange an entry that
// another one would outrank, until no entry changes. If that has no end, or leaves the team that submitted
// with a lower rank than it had before, the other teams keep their entries. So the submission that was
// accepted last never lowers the rank of its own team.
std::vector<size_t> StandingEntries(const std::vector<BandCandidate>& candidates,
                                    const std::function<bool(double, double)>& belongs);

}  // namespace myograde::scoring
