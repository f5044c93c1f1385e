// Where the attempts of leases ran and what they used, and which nodes of a cluster get no leases.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace myograde::server {

// How an attempt of a lease ended.
enum class RunEnd {
  kDone,
  kFault,      // the grader's
  kReturned,   // nobody's fault: it is played again
  kCancelled,
};
std::string_view RunEndName(RunEnd end);
std::optional<RunEnd> ParseRunEnd(std::string_view name);

// An attempt that has ended. Times are milliseconds since 1970-01-01 UTC, by the daemon's clock.
struct LeaseRunRow {
  int64_t lease = 0;
  int64_t attempt = 0;
  std::string node = {};          // "": the daemon's own host
  std::string job = {};           // the cluster's name for it; "": none
  int64_t began_at = 0;           // 0: it never began
  int64_t ended_at = 0;
  double cpu_s = 0;               // of all its processes, exact to the millisecond; 0: not known
  std::optional<double> energy_j = {};  // exact to the millijoule; nullopt: not measured
  RunEnd how = RunEnd::kDone;
};

// A node that gets no leases.
struct DrainedNodeRow {
  int64_t id = 0;  // of the event
  int64_t at = 0;
  std::string node;
  std::string who;
  std::string why;
};

}  // namespace myograde::server
