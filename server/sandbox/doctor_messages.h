// What a message between two processes costs on this host. A graded step is a handful of
// them beside its physics, so the share of a step that is not physics depends on it, and it
// differs between machines more than the speed of the physics does.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/sandbox/doctor.h"

namespace myograde::server {

// The time for a message to another process on the same processor and its answer, the smallest
// mean of several batches; nullopt if two processes can't be made. Takes some 50 ms.
// REQUIRES: a single thread.
std::optional<absl::Duration> MeasureMessages();

// What it means for a step. `mitigations`: what the kernel does about the processor's faults.
Check JudgeMessages(std::optional<absl::Duration> there_and_back, const std::string& mitigations);

// Measures on this host and appends a check.
void CheckMessages(std::vector<Check>& checks);

}  // namespace myograde::server
