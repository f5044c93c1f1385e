#include "server/base/ip_address.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"

namespace myograde::server {
namespace {

constexpr size_t kV4 = 12;           // where an IPv4 address begins
constexpr size_t kNetworkBytes = 8;  // of an IPv6 address, the /64

in6_addr Mapped(const in_addr& v4) {
  in6_addr address = {};
  address.s6_addr[kV4 - 2] = address.s6_addr[kV4 - 1] = 0xff;
  std::memcpy(address.s6_addr + kV4, &v4, sizeof(v4));
  return address;
}

std::string TextOf(int family, const uint8_t* bytes) {
  char text[INET6_ADDRSTRLEN] = "";
  inet_ntop(family, bytes, text, sizeof(text));
  return text;
}

}  // namespace

std::optional<IpAddress> IpAddress::Parse(const std::string& text) {
  in_addr v4 = {};
  in6_addr v6 = {};
  if (inet_pton(AF_INET, text.c_str(), &v4) == 1) return IpAddress(Mapped(v4));
  if (inet_pton(AF_INET6, text.c_str(), &v6) == 1) return IpAddress(v6);
  return std::nullopt;
}

std::optional<IpAddress> IpAddress::Of(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET) {
    return IpAddress(Mapped(reinterpret_cast<const sockaddr_in&>(address).sin_addr));
  }
  if (address.ss_family != AF_INET6) return std::nullopt;
  return IpAddress(reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
}

bool IpAddress::IsLoopback() const {
  return is_v4() ? address_.s6_addr[kV4] == 127 : IN6_IS_ADDR_LOOPBACK(&address_) != 0;
}

std::string IpAddress::Key() const {
  if (is_v4()) return absl::StrCat("address ", UrlHost());
  in6_addr network = address_;
  std::fill(std::begin(network.s6_addr) + kNetworkBytes, std::end(network.s6_addr), uint8_t{0});
  return absl::StrCat("address ", TextOf(AF_INET6, network.s6_addr), "/64");
}

std::string IpAddress::UrlHost() const {
  if (is_v4()) return TextOf(AF_INET, address_.s6_addr + kV4);
  return absl::StrCat("[", TextOf(AF_INET6, address_.s6_addr), "]");
}

sockaddr_storage IpAddress::SocketAddress(uint16_t port, socklen_t& size) const {
  sockaddr_storage address = {};
  if (is_v4()) {
    auto& v4 = reinterpret_cast<sockaddr_in&>(address);
    v4.sin_family = AF_INET;
    v4.sin_port = htons(port);
    std::memcpy(&v4.sin_addr, address_.s6_addr + kV4, sizeof(v4.sin_addr));
    size = sizeof(v4);
  } else {
    auto& v6 = reinterpret_cast<sockaddr_in6&>(address);
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(port);
    v6.sin6_addr = address_;
    size = sizeof(v6);
  }
  return address;
}

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
