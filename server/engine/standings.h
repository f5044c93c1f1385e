// What boards are ranked by, computed from episode rows. The store caches it as a view, so that a
// board need not read every episode; it can be rebuilt at any time.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/track_config.h"
#include "server/store/reader.h"
#include "server/store/store.h"

namespace myograde::server {

// The standing of an evaluation in the store.
absl::StatusOr<Standing> ReadStanding(Reader& reader, int64_t evaluation);

// By evaluation: all that are done, or only those missing from the view. Unreadable ones are left
// out.
using Standings = Listed<std::pair<int64_t, Standing>>;
absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only);

// Adds what the view lacks. Returns what could not be read.
absl::StatusOr<std::vector<Damage>> FillStandings(Store& store, ReaderPool& readers);

}  // namespace myograde::server
