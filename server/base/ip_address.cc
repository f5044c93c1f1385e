#include "server/base/ip_address.h"

#include <absl/strings/str_cat.h>
#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstring>

namespace myograde::server {
namespace {

constexpr std::array<uint8_t, 12> kMapped = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
constexpr size_t kNetworkBytes = 8;  // of an IPv6 address, the /64

std::string TextOf(int family, const uint8_t* bytes) {
  char text[INET6_ADDRSTRLEN] = "";
  inet_ntop(family, bytes, text, sizeof(text));
  return text;
}

}  // namespace

std::optional<IpAddress> IpAddress::Parse(const std::string& text) {
  std::array<uint8_t, 16> bytes = {};
  if (inet_pton(AF_INET, text.c_str(), bytes.data()) == 1) return IpAddress(true, bytes);
  if (inet_pton(AF_INET6, text.c_str(), bytes.data()) == 1) return IpAddress(false, bytes);
  return std::nullopt;
}

std::optional<IpAddress> IpAddress::Of(const sockaddr_storage& address) {
  std::array<uint8_t, 16> bytes = {};
  if (address.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    std::memcpy(bytes.data(), &v4.sin_addr, sizeof(v4.sin_addr));
    return IpAddress(true, bytes);
  }
  if (address.ss_family != AF_INET6) return std::nullopt;
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
  std::memcpy(bytes.data(), &v6.sin6_addr, sizeof(v6.sin6_addr));
  return IpAddress(false, bytes);
}

bool IpAddress::IsMapped() const {
  return !v4_ && std::equal(kMapped.begin(), kMapped.end(), bytes_.begin());
}

bool IpAddress::IsLoopback() const {
  if (v4_) return bytes_[0] == 127;
  if (IsMapped()) return bytes_[kMapped.size()] == 127;
  return bytes_.back() == 1 &&
         std::all_of(bytes_.begin(), bytes_.end() - 1, [](uint8_t byte) { return byte == 0; });
}

std::string IpAddress::Key() const {
  if (v4_) return absl::StrCat("address ", TextOf(AF_INET, bytes_.data()));
  if (IsMapped()) return absl::StrCat("address ", TextOf(AF_INET, bytes_.data() + kMapped.size()));
  std::array<uint8_t, 16> network = bytes_;
  std::fill(network.begin() + kNetworkBytes, network.end(), uint8_t{0});
  return absl::StrCat("address ", TextOf(AF_INET6, network.data()), "/64");
}

std::string IpAddress::UrlHost() const {
  if (v4_) return TextOf(AF_INET, bytes_.data());
  return absl::StrCat("[", TextOf(AF_INET6, bytes_.data()), "]");
}

sockaddr_storage IpAddress::SocketAddress(uint16_t port, socklen_t& size) const {
  sockaddr_storage address = {};
  if (v4_) {
    auto& v4 = reinterpret_cast<sockaddr_in&>(address);
    v4.sin_family = AF_INET;
    v4.sin_port = htons(port);
    std::memcpy(&v4.sin_addr, bytes_.data(), sizeof(v4.sin_addr));
    size = sizeof(v4);
  } else {
    auto& v6 = reinterpret_cast<sockaddr_in6&>(address);
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(port);
    std::memcpy(&v6.sin6_addr, bytes_.data(), sizeof(v6.sin6_addr));
    size = sizeof(v6);
  }
  return address;
}

}  // namespace myograde::server
