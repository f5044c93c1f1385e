// What people see of a cluster's nodes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <absl/time/time.h>

namespace myograde::server {

struct DrainedNode {
  std::string node;
  std::string why;  // one sentence
};

struct NodeView {
  std::string name;
  // "new": it has not proved itself yet; "proved"; "drained".
  std::string state;
  std::string why;        // of a drained one
  std::string processor;  // as it describes itself; "": not known
  int running = 0;        // leases
  int64_t done = 0;       // leases that ended well, since the daemon started
  int64_t faults = 0;     // those that ended by the grader's fault
};

}  // namespace myograde::server
