// Reads episode logs, and compares two runs of an episode by them: which came first, a different
// action or a different state? That tells a non-repeatable policy from a non-deterministic
// simulator.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/log/episode_log.h"
#include "protocol/log/packed_log.h"

namespace myograde::server {

// Reads a log file, packed or not. NotFoundError if it can't be opened; otherwise as ReadPackedLog.
absl::StatusOr<std::string> ReadLog(const std::string& path);

// DataLossError if a log's SHA-256, `found`, is not the one that its record names.
absl::Status CheckLogHash(const std::string& named, const std::string& found);

enum class Cause {
  kNone,       // the logs are equal as far as both go
  kPolicy,     // it acted differently though it had seen the same
  kSimulator,  // a different observation or state though all actions before were the same
};

struct LogDifference {
  Cause cause = Cause::kNone;
  int64_t step = -1;    // the first that differs; -1: before the first, or none
  std::string detail;   // one sentence
};

LogDifference CompareLogs(const EpisodeLog& first, const EpisodeLog& second);

}  // namespace myograde::server
