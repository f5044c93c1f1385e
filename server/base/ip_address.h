// Addresses of the internet, of either version, as limits count by them; and this host among
// others: its name and address, and what it may send them.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <cstdint>
#include <optional>
#include <string>

namespace myograde::server {

class IpAddress {
 public:
  // "192.0.2.1" or "2001:db8::1"; no names and no brackets. nullopt: it is neither.
  static std::optional<IpAddress> Parse(const std::string& text);
  // nullopt: it is not an address of the internet.
  static std::optional<IpAddress> Of(const sockaddr_storage& address);

  // Whether nobody outside of this host can use it.
  bool IsLoopback() const;
  // Identifies whoever has the address, for limits and rows: "address 192.0.2.1". Of an IPv6
  // address only the /64 counts, as anybody who has one has all of it: "address 2001:db8::/64". An
  // IPv4 address has the same key however it is written.
  std::string Key() const;
  // As it stands in a URL: IPv6 in brackets.
  std::string UrlHost() const;
  // For bind and connect; `size` is set to its length.
  sockaddr_storage SocketAddress(uint16_t port, socklen_t& size) const;

 private:
  explicit IpAddress(const in6_addr& address) : address_(address) {}
  bool is_v4() const { return IN6_IS_ADDR_V4MAPPED(&address_) != 0; }

  in6_addr address_;  // of IPv4 ::ffff:192.0.2.1, as which a socket of IPv6 has such peers
};

// This host's name; "unknown" if it has none.
std::string HostName();

// Whether the kernel refuses to send packets of this process to `address` (systemd's
// IPAddressDeny=). Sends an empty datagram to the discard port there.
bool IsRefused(const IpAddress& address);

// An address of this host that other hosts reach; nullopt if it has none. What is sent to it stays
// on this host, but is filtered like everything that leaves it.
std::optional<IpAddress> OwnAddress();

}  // namespace myograde::server
