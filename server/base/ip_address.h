// Addresses of the internet, of either version, as limits count by them.
#pragma once

#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace myograde::server {

class IpAddress {
 public:
  // "192.0.2.1" or "2001:db8::1"; no names and no brackets. nullopt: it is neither.
  static std::optional<IpAddress> Parse(const std::string& text);
  // nullopt: it is no address of the internet.
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
  IpAddress(bool v4, const std::array<uint8_t, 16>& bytes) : v4_(v4), bytes_(bytes) {}
  // A socket of IPv6 has IPv4 peers as ::ffff:192.0.2.1.
  bool IsMapped() const;

  bool v4_;
  std::array<uint8_t, 16> bytes_;  // of IPv4 the first four
};

}  // namespace myograde::server
