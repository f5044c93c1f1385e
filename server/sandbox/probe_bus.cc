// The part of the doctor that runs inside a policy's sandbox.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include "protocol/base/fd.h"
#include "protocol/channels.h"
#include "server/sandbox/doctor.h"

namespace myograde::server {

int ProbeBus() {
  const auto fail = [](const char* what) {
    dprintf(STDERR_FILENO, "the bus of the sandbox: %s: %s\n", what, std::strerror(errno));
    return 1;
  };
  const Fd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!socket.valid()) return fail("no socket");
  sockaddr_in group = {};
  group.sin_family = AF_INET;
  group.sin_port = htons(kBusPort);
  inet_pton(AF_INET, kBusGroup, &group.sin_addr);
  const auto* address = reinterpret_cast<const sockaddr*>(&group);
  ip_mreq membership = {group.sin_addr, {htonl(INADDR_ANY)}};
  const uint8_t hops = 0;
  if (bind(socket.get(), address, sizeof(group)) != 0) return fail("bind");
  if (setsockopt(socket.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof(membership)) !=
          0 ||
      setsockopt(socket.get(), IPPROTO_IP, IP_MULTICAST_TTL, &hops, sizeof(hops)) != 0) {
    return fail("joining the multicast group");
  }
  const char sent[] = "myograde doctor";
  if (sendto(socket.get(), sent, sizeof(sent), 0, address, sizeof(group)) != sizeof(sent)) {
    return fail("sending");
  }
  pollfd entry = {socket.get(), POLLIN, 0};
  errno = ETIMEDOUT;
  char got[sizeof(sent)] = {};
  if (poll(&entry, 1, 2000) != 1 || recv(socket.get(), got, sizeof(got), 0) != sizeof(sent) ||
      std::memcmp(sent, got, sizeof(sent)) != 0) {
    return fail("the datagram did not come back");
  }
  return 0;
}

}  // namespace myograde::server
