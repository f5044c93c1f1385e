#include "server/sandbox/network.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>

namespace myograde::server {
namespace {

constexpr uint32_t kBusNetwork = 0xEFFF0000;  // 239.255.0.0
constexpr uint32_t kBusMask = 0xFFFF0000;

sockaddr Address(uint32_t address) {
  sockaddr_in inet = {};
  inet.sin_family = AF_INET;
  inet.sin_addr.s_addr = htonl(address);
  sockaddr generic;
  std::memcpy(&generic, &inet, sizeof(generic));
  return generic;
}

int SetUp(int socket) {
  ifreq request = {};
  std::memcpy(request.ifr_name, "lo", 3);
  if (ioctl(socket, SIOCGIFFLAGS, &request) != 0) return errno;
  request.ifr_flags = static_cast<int16_t>(request.ifr_flags | IFF_UP | IFF_RUNNING | IFF_MULTICAST);
  if (ioctl(socket, SIOCSIFFLAGS, &request) != 0) return errno;
  char device[] = "lo";
  rtentry route = {};
  route.rt_dst = Address(kBusNetwork);
  route.rt_genmask = Address(kBusMask);
  route.rt_flags = RTF_UP;
  route.rt_dev = device;
  if (ioctl(socket, SIOCADDRT, &route) != 0) return errno;
  return 0;
}

}  // namespace

int SetUpLoopback() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return errno;
  const int error = SetUp(socket);
  close(socket);
  return error;
}

}  // namespace myograde::server
