// What a caller may see of an evaluation: a phase of a challenge may withhold parts of it from its
// participants. The one place that decides it; server/api/redaction.h applies it to answers. Pure.
#pragma once

#include <string_view>
#include <vector>

#include "server/access/access.h"

namespace myograde::server {

// What a phase shows to a team of its own evaluations. Organisers see everything.
struct Visibility {
  bool aggregate = true;   // the means that the board ranks by
  bool outcomes = true;    // outcome and reason of each episode
  bool metrics = true;     // metrics, steps and digests of each episode
  bool logs = true;        // facts, details and log of each episode
  bool output = true;      // what the policy printed, and the text of its faults
  bool seeds = true;       // false as long as committed seeds are not revealed
  bool progress = true;    // what goes on inside a lease, and the single episodes of an evaluation that
                           // is not done: false while anything above is withheld and the phase is not
                           // published, as nothing may be charged for them

  bool operator==(const Visibility&) const = default;
};

// What is known of the phase that an evaluation belongs to. The default is that of evaluations
// outside of all phases: nothing is withheld.
struct PhaseSight {
  Visibility shown = {};   // while it is not published, as its file says; `seeds` is ignored
  bool published = false;
  bool committed = false;  // its seeds are hidden until they are revealed
  bool revealed = false;   // which publishes it, too
};

// A phase that no file describes any more: until it is published, its teams see the aggregate and
// nothing else.
inline constexpr Visibility kSightOfUnknownPhase = {.aggregate = true,
                                                    .outcomes = false,
                                                    .metrics = false,
                                                    .logs = false,
                                                    .output = false,
                                                    .seeds = false,
                                                    .progress = false};

Visibility SightOf(Role role, const PhaseSight& phase);

// Whether nothing is withheld.
inline bool SeesAll(const Visibility& sight) { return sight == Visibility{}; }
// Whether the file of a log may be read: it holds its episode's seed.
inline bool SeesLogs(const Visibility& sight) { return sight.logs && sight.seeds; }
// Whether a receipt may be read: it lists outcome and metrics of each episode.
inline bool SeesReceipt(const Visibility& sight) { return sight.outcomes && sight.metrics; }

// The names of what is withheld, as a challenge file's "show" calls them, and "seeds".
std::vector<std::string_view> WithheldParts(const Visibility& sight);

}  // namespace myograde::server
