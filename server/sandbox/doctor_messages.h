// The cost of a message between two processes on this host. A graded step is a handful of messages
// besides its physics, so this cost determines the step's overhead, and it varies between machines
// more than the speed of the physics does.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/sandbox/doctor.h"

namespace myograde::server {

// The round-trip time of a message to another process on the same processor: the smallest mean of
// several batches. nullopt if two processes can't be created. Takes about 50 ms. REQUIRES: a single
// thread.
std::optional<absl::Duration> MeasureMessages();

// What it means for a step. `mitigations`: the kernel's mitigations of processor vulnerabilities.
Check JudgeMessages(std::optional<absl::Duration> there_and_back, const std::string& mitigations);

// Measures on this host and appends a check.
void CheckMessages(std::vector<Check>& checks);

}  // namespace myograde::server
