// What a lease used beside its episodes. Pure.
#pragma once

#include <cstdint>
#include <vector>

#include "server/store/rows.h"

namespace myograde::server {

// CPU time (s) of a policy outside of its episodes: its start, until it was ready for its first episode
// (of all starts, if it was started again), and its end. `lease_cpu_s`: all that it used in the lease of
// the episodes `first` to `last`, whose rows are among `rows`. Rows of older versions count the start to
// the first episode.
double StartUpCpu(double lease_cpu_s, const std::vector<EpisodeRow>& rows, int64_t first,
                  int64_t last);

}  // namespace myograde::server
