// Which phase a ranked submission belongs to.
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/challenge/phases.h"

namespace myograde::server {

// What a participant asks for; "" is anything.
struct PhaseQuery {
  std::string phase;
  std::string track;    // required
  std::string profile;
};

// Whether ranked submissions to a track need a phase.
bool HasPhases(const Phases& phases, const std::string& track);

// The phase of the query's name, whatever its state; without a name, the only one of the track that
// is open by the calendar.
//   NotFoundError            code "unknown_phase"; or as Phases::Find
//   InvalidArgumentError     it is of another track or profile, or several are open
//   FailedPreconditionError  code "phase_closed": none is open; says which one opens next
absl::StatusOr<PhasePtr> FindPhase(const Phases& phases, const PhaseQuery& query, absl::Time now);

}  // namespace myograde::server
