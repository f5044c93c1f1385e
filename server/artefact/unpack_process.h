// Unpacking in a process of its own, for programs that others depend on: an
// archive can make the parser slow, hungry or crash, and then only that process
// ends. One that takes it over finds itself in an empty folder with no rights
// (confine_unpack.h).
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct UnpackBudget {
  absl::Duration time;       // of wall time
  int64_t memory_bytes = 0;  // of address space
};

// UnpackArtefact in the program myograde-unpack beside the running one, or where that
// is not there in a fresh copy of the running one, whose main must begin with
// RunUnpackProcess. Any thread may call it; it returns soon after the
// budget's time at the latest. Errors as of UnpackArtefact; an archive that
// breaks the budget or the process is an InvalidArgumentError too. Nothing is
// left at `destination` then.
absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget);

// Where the arguments are those of such a process: does its work and ends the
// process, or, if they make no sense, returns with `status` for main. False: they
// are not.
bool RunUnpackProcess(int argc, char** argv, int& status);

}  // namespace myograde::server
