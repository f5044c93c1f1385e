// The network of a sandbox with the bus: a loopback that carries LCM, limits on what its sockets
// may hold, and what can be measured from outside.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// The limit of each TCP socket buffer in such a network, in bytes.
inline constexpr int64_t kStreamBufferBytes = 212992;

// A sample of such a network's use.
struct NetworkUse {
  // Its UDP and TCP sockets that have an address: those that can hold data for a reader.
  int64_t sockets = 0;
  // Sockets of all kinds that processes in it have open.
  int64_t all_sockets = 0;
  // The UDP sockets of the whole host hold so much that the kernel starts to drop messages (the
  // second number of net.ipv4.udp_mem).
  bool pool_full = false;
};

class BusNetwork {
 public:
  // Creates a network namespace with the bus; the calling thread stays in its own. The namespace
  // lasts until this object and all processes in it are gone. UnavailableError says what the kernel
  // refused.
  static absl::StatusOr<BusNetwork> Make();

  // The namespace, for setns(2).
  int fd() const { return namespace_.get(); }

  // Takes a few microseconds.
  NetworkUse Sample() const;

  // Kernel memory held by its UDP and TCP sockets, in bytes, by the kernel's own count, in which
  // memory shared by several sockets counts for each; 0 if unknown. Takes milliseconds on a host
  // with large tables.
  int64_t socket_bytes() const;

  // Datagrams that the kernel dropped in it because the host's UDP sockets had reached their shared
  // limit. Also 0 where the kernel does not count them: before Linux 5.12, and in 6.18.
  int64_t dropped() const;

  // False: the kernel's settings can't be written here, so TCP sockets may hold as much as the
  // host's settings allow.
  bool bounded() const { return bounded_; }

 private:
  Fd namespace_;
  Fd sockets_;      // the namespace's /proc/net/sockstat
  Fd sockets_six_;  // ... and sockstat6; invalid without IPv6
  Fd counters_;     // ... and snmp
  Fd diagnosis_;    // of sock_diag(7); invalid if the kernel lacks it
  bool bounded_ = false;
  int64_t full_pages_ = 0;  // of the host's UDP sockets; 0: unknown
};

// The number after the word `field` in the line of `text` that begins with `name`, in the format of
// /proc/net/sockstat; 0 if there is none.
int64_t SocketStatistic(const std::string& text, const std::string& name, const std::string& field);

// The number below the word `field` in the lines of `text` that begin with `name`, in the format of
// /proc/net/snmp: a line of words, then a line of numbers.
int64_t CounterBelow(const std::string& text, const std::string& name, const std::string& field);

}  // namespace myograde::server
