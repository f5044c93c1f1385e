// Two playings of one episode, compared by their logs: which came first, another
// action or another state? That tells a policy that is not repeatable from a
// simulator that is not.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/log/episode_log.h"

namespace myograde::server {

enum class Cause {
  kNone,       // the logs are equal as far as both go
  kPolicy,     // it acted otherwise though it had seen the same
  kSimulator,  // another observation or state though all actions before were the same
};

struct LogDifference {
  Cause cause = Cause::kNone;
  int64_t step = -1;    // the first that differs; -1: before the first, or none
  std::string detail;   // one sentence
};

LogDifference CompareLogs(const EpisodeLog& first, const EpisodeLog& second);

}  // namespace myograde::server
