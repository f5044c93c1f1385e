#include "server/base/ip_address.h"

#include <arpa/inet.h>

#include <algorithm>
#include <cstring>

#include <absl/strings/str_cat.h>

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

}  // namespace myograde::server
