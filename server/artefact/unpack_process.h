// Unpacking in a process of its own, for programs that others depend on: an
// archive can make the parser slow, hungry or crash, and then only that process
// ends. One that takes it over finds itself in an empty folder with no rights
// (confine_unpack.h).
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

struct UnpackBudget {
  absl::Duration time;       // of wall time
  int64_t memory_bytes = 0;  // of address space
  absl::Duration cpu = absl::Hours(1);  // of processor time, in whole seconds
  // Asked about ten times a second; unless it is OkStatus(), the unpacking is ended with it.
  std::function<absl::Status()> go_on = [] { return absl::OkStatus(); };
};

// UnpackArtefact in the program myograde-unpack beside the running one, or where that
// is not there in a fresh copy of the running one, whose main must begin with
// RunUnpackProcess. Any thread may call it; it returns soon after the
// budget's time at the latest. Errors as of UnpackArtefact. An archive that takes
// too much memory or processor time, or crashes the process, is an
// InvalidArgumentError too. What says nothing about the archive is another error:
// a host that was too busy DeadlineExceededError, a process that was ended from
// outside UnavailableError. Nothing is left at `destination` then.
absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget);

// Where the arguments are those of such a process: does its work and ends the
// process, or, if they make no sense, returns with `status` for main. False: they
// are not.
bool RunUnpackProcess(int argc, char** argv, int& status);

}  // namespace myograde::server
