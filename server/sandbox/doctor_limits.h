// The checks of what all leases of a host share in its kernel, and of the limits
// that keep one lease from taking it from the others.
#pragma once

#include <cstdint>
#include <vector>

#include "server/sandbox/doctor.h"

namespace myograde::server {

// What the sockets of all slots together can hold at most, and what the kernel
// lets those of the whole host hold. All in bytes.
struct SocketMemory {
  int64_t slots = 1;
  int64_t sockets = 0;       // of one sandbox
  int64_t usual_buffer = 0;  // net.core.rmem_default
  int64_t udp_total = 0;     // net.ipv4.udp_mem, the last
  int64_t tcp_total = 0;     // net.ipv4.tcp_mem, the last
  bool bounded = false;      // TCP's buffers are, see BusNetwork::bounded()
};
Check JudgeSocketMemory(const SocketMemory& memory);

// Descriptors that may be in flight between processes of the daemon's user.
struct FlightLimits {
  int64_t slots = 1;
  int64_t open_files = 0;  // of one process of a policy
  int64_t tasks = 0;       // of one policy
  int64_t own = 0;         // files that this user's own processes may open at most; -1: any number
};
Check JudgeFlight(const FlightLimits& limits);

// Reads both from this host and appends a check for each.
void CheckSharedLimits(const DoctorOptions& options, std::vector<Check>& checks);

}  // namespace myograde::server
