// The network of a sandbox that has the bus: a loopback that carries LCM, what
// its sockets may hold at most, and what of it can be seen from outside.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// Bytes that each buffer of a TCP socket may grow to in such a network.
inline constexpr int64_t kStreamBufferBytes = 212992;

// What is seen of such a network at one moment.
struct NetworkUse {
  // UDP and TCP sockets in it that have an address, which are those that can hold
  // data for a reader.
  int64_t sockets = 0;
  // Sockets of all kinds that processes in it have open.
  int64_t all_sockets = 0;
  // The UDP sockets of the whole host hold so much that the kernel begins to
  // drop messages (the second number of net.ipv4.udp_mem).
  bool pool_full = false;
};

class BusNetwork {
 public:
  // Makes a network namespace with the bus; this thread stays in its own. It
  // lasts until this value and all processes in it are gone. UnavailableError
  // says what the kernel refuses.
  static absl::StatusOr<BusNetwork> Make();

  // The namespace, for setns(2).
  int fd() const { return namespace_.get(); }

  // Takes some microseconds.
  NetworkUse Look() const;

  // Bytes of the kernel's memory that the UDP and TCP sockets in it hold, see
  // SocketBytes().
  int64_t socket_bytes() const;

  // Datagrams that the kernel has dropped in it because the UDP sockets of the
  // whole host held all that they may. 0 also where the kernel does not count
  // them: before Linux 5.12, and 6.18.
  int64_t dropped() const;

  // False: the kernel's settings can't be written here, so TCP sockets may hold
  // what the host's settings allow.
  bool bounded() const { return bounded_; }

 private:
  Fd namespace_;
  Fd sockets_;      // /proc/net/sockstat as it is in there
  Fd sockets_six_;  // ... and sockstat6; invalid without IPv6
  Fd counters_;     // ... and snmp
  Fd diagnosis_;
  bool bounded_ = false;
  int64_t full_pages_ = 0;  // of the whole host's UDP sockets; 0: not known here
};

// The number behind the word `field` in the line of `text` that begins with
// `name`, as /proc/net/sockstat has them; 0 if there is none.
int64_t SocketStatistic(const std::string& text, const std::string& name, const std::string& field);

// The number below the word `field` in the lines of `text` that begin with
// `name`, as /proc/net/snmp has them: one line of words, one of numbers.
int64_t CounterBelow(const std::string& text, const std::string& name, const std::string& field);

}  // namespace myograde::server
