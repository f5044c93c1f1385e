#include "server/base/this_host.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include "protocol/base/fd.h"

namespace myograde::server {

std::string HostName() {
  char name[256] = {};
  return gethostname(name, sizeof(name) - 1) == 0 ? name : "unknown";
}

bool IsRefused(const IpAddress& address) {
  constexpr uint16_t kDiscard = 9;
  socklen_t size = 0;
  const sockaddr_storage place = address.SocketAddress(kDiscard, size);
  const Fd sender(::socket(place.ss_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  return sender.valid() &&
         ::sendto(sender.get(), "", 0, MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&place),
                  size) < 0 &&
         errno == EPERM;
}

std::optional<IpAddress> OwnAddress() {
  ifaddrs* found = nullptr;
  if (::getifaddrs(&found) != 0) return std::nullopt;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> all(found, ::freeifaddrs);
  for (const ifaddrs* each = found; each != nullptr; each = each->ifa_next) {
    if (each->ifa_addr == nullptr || (each->ifa_flags & IFF_UP) == 0) continue;
    // Addresses of IPv6 that are good for one link only would need its number.
    if (each->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_storage storage = {};
    std::memcpy(&storage, each->ifa_addr, sizeof(sockaddr_in));
    const std::optional<IpAddress> address = IpAddress::Of(storage);
    if (address.has_value() && !address->IsLoopback()) return address;
  }
  return std::nullopt;
}

}  // namespace myograde::server
