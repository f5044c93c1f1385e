// Unpacks in a separate process, for programs that must stay up: an archive that makes the parser
// slow, hungry or crash affects only that process, and one that takes it over finds itself in an
// empty folder without privileges (ConfineUnpacking).
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

// REQUIRES: each is above 0.
struct UnpackBudget {
  absl::Duration time;       // wall time
  int64_t memory_bytes = 0;  // address space
  absl::Duration cpu = absl::Hours(1);  // processor time, in whole seconds
  // Called about ten times a second; any error ends the unpacking and becomes its result.
  std::function<absl::Status()> go_on = [] { return absl::OkStatus(); };
};

// Runs UnpackArtefact in the program myograde-unpack of BinDir(). Thread-safe; returns soon after
// `budget`'s time at the latest. Errors as of UnpackArtefact; an archive that takes too much memory
// or processor time, or crashes the process, is an InvalidArgumentError too. Failures that say
// nothing about the archive: DeadlineExceededError for a host that was too busy, UnavailableError
// for a process that was killed from outside. Nothing is left at `destination` then.
absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget);

// The whole of myograde-unpack: its exit status if the arguments are malformed; else it does not
// return.
int RunUnpackProcess(int argc, char** argv);

// For a single-threaded process that has opened all it needs. Leaves it `folder` (a descriptor) and
// what is below as its whole file system, no capabilities and no way to gain any, and the few
// system calls that unpacking makes; any other kills it with SIGSYS (README.md).
// UnavailableError: this host does not permit it.
absl::Status ConfineUnpacking(int folder);

}  // namespace myograde::server
