// What boards are ranked by, made of episode rows. The store keeps it as a view,
// so that a board need not read every episode; it can be made again at any time.
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

// What an evaluation in the store is ranked by.
absl::StatusOr<Standing> ReadStanding(Reader& reader, int64_t evaluation);

// By evaluation: of all that are done, or only of those that the view lacks. Those that can't be
// read are left out.
using Standings = Listed<std::pair<int64_t, Standing>>;
absl::StatusOr<Standings> MakeStandings(ReaderPool& readers, bool missing_only);

// Gives the view what it lacks; for a store that an earlier version wrote. Returns what could not
// be read.
absl::StatusOr<std::vector<Damage>> FillStandings(Store& store, ReaderPool& readers);

}  // namespace myograde::server
