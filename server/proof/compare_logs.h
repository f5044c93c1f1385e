// Compares two runs of an episode by their logs: which came first, a different action or a
// different state? That tells a non-repeatable policy from a non-deterministic simulator.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/log/episode_log.h"

namespace myograde::server {

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
