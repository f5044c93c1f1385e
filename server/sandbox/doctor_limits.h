// Checks of the kernel resources that all leases of a host share, and of the limits that keep one
// lease from exhausting them.
#pragma once

#include <cstdint>
#include <vector>

#include "server/sandbox/doctor.h"

namespace myograde::server {

// The most that the sockets of all slots together can hold, and what the kernel allows for the
// whole host. In bytes.
struct SocketMemory {
  int64_t slots = 1;
  int64_t sockets = 0;       // per sandbox
  int64_t usual_buffer = 0;  // net.core.rmem_default
  int64_t udp_total = 0;     // net.ipv4.udp_mem, the last
  int64_t tcp_total = 0;     // net.ipv4.tcp_mem, the last
  bool bounded = false;      // TCP buffers are bounded, see BusNetwork::bounded()
};
Check JudgeSocketMemory(const SocketMemory& memory);

// Descriptors in flight between processes of the daemon's user.
struct FlightLimits {
  int64_t slots = 1;
  int64_t open_files = 0;  // per process of a policy
  int64_t tasks = 0;       // per policy
  int64_t own = 0;         // how many files this user's own processes may open; -1: unlimited
};
Check JudgeFlight(const FlightLimits& limits);

// Reads both from this host and appends a check for each.
void CheckSharedLimits(const DoctorOptions& options, std::vector<Check>& checks);

}  // namespace myograde::server
