// Unpacks in a separate process, for programs that must stay up: an archive that makes the parser
// slow, hungry or crash affects only that process, and one that takes it over finds itself in an
// empty folder without privileges (confine_unpack.h).
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct UnpackBudget {
  absl::Duration time;       // wall time
  int64_t memory_bytes = 0;  // address space
  absl::Duration cpu = absl::Hours(1);  // processor time, in whole seconds
  // Called about ten times a second; any error ends the unpacking and becomes its result.
  std::function<absl::Status()> go_on = [] { return absl::OkStatus(); };
};

// Runs UnpackArtefact in the program myograde-unpack beside the running one, or if that is missing
// in a fresh copy of the running one, whose main must begin with RunUnpackProcess. Thread-safe;
// returns soon after `budget`'s time at the latest. Errors as of UnpackArtefact; an archive that
// takes too much memory or processor time, or crashes the process, is an InvalidArgumentError too.
// Failures that say nothing about the archive: DeadlineExceededError for a host that was too busy,
// UnavailableError for a process that was killed from outside. Nothing is left at `destination`
// then.
absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget);

// If the arguments are those of an unpack process: does its work and exits, or, if they are
// malformed, returns true with the exit `status` for main. False: they are not.
bool RunUnpackProcess(int argc, char** argv, int& status);

}  // namespace myograde::server
