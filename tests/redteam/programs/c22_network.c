// Tries to reach anything beyond the sandbox' own bus, reports each attempt, then becomes an
// honest policy. Addresses are those reserved for documentation.
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#include "report.h"

static void Connect(const char* name, int type, const char* address, int port) {
  const int fd = socket(AF_INET, type, 0);
  struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((unsigned short)port)};
  inet_pton(AF_INET, address, &to.sin_addr);
  int result = connect(fd, (struct sockaddr*)&to, sizeof(to));
  if (result == 0 && type == SOCK_DGRAM) result = (int)send(fd, "x", 1, 0);
  Report(name, result);
  close(fd);
}

static void Connect6(const char* name, const char* address) {
  const int fd = socket(AF_INET6, SOCK_STREAM, 0);
  struct sockaddr_in6 to = {.sin6_family = AF_INET6, .sin6_port = htons(80)};
  inet_pton(AF_INET6, address, &to.sin6_addr);
  Report(name, fd < 0 ? -1 : connect(fd, (struct sockaddr*)&to, sizeof(to)));
  close(fd);
}

static void Unix(const char* name, const char* path, int abstract) {
  const int fd = socket(AF_UNIX, SOCK_STREAM, 0);
  struct sockaddr_un to = {.sun_family = AF_UNIX};
  strncpy(to.sun_path + abstract, path, sizeof(to.sun_path) - 2);
  const size_t size = offsetof(struct sockaddr_un, sun_path) + (size_t)abstract + strlen(path);
  Report(name, connect(fd, (struct sockaddr*)&to, (socklen_t)size));
  close(fd);
}

static void Family(const char* name, int family, int type, int protocol) {
  const int fd = socket(family, type, protocol);
  Report(name, fd);
  if (fd >= 0) close(fd);
}

int main(int argc, char** argv) {
  Connect("internet_tcp", SOCK_STREAM, "192.0.2.1", 80);
  Connect("internet_udp", SOCK_DGRAM, "198.51.100.1", 53);
  Connect("link_local", SOCK_STREAM, "169.254.169.254", 80);
  Connect("private", SOCK_STREAM, "10.0.0.1", 22);
  Connect6("internet_six", "2001:db8::1");
  Connect6("link_local_six", "fe80::1");
  for (int i = 1; i + 1 < argc; i += 2) {
    // Host services: a TCP port on its 127.0.0.1, sockets by path and by abstract name.
    const char* kind = argv[i];
    const char* place = argv[i + 1];
    if (strcmp(kind, "tcp") == 0) Connect("host_loopback", SOCK_STREAM, "127.0.0.1", atoi(place));
    if (strcmp(kind, "unix") == 0) Unix("host_unix", place, 0);
    if (strcmp(kind, "abstract") == 0) Unix("host_abstract", place, 1);
  }
  Family("netlink", AF_NETLINK, SOCK_RAW, 0);
  Family("netlink_dgram", AF_NETLINK, SOCK_DGRAM, 0);
  Family("vsock", 40, SOCK_STREAM, 0);
  Family("packet", 17, SOCK_RAW, 0);
  Family("packet_dgram", 17, SOCK_DGRAM, 0);
  Family("raw_icmp", AF_INET, SOCK_RAW, IPPROTO_ICMP);
  Family("raw_ip", AF_INET, SOCK_RAW, IPPROTO_RAW);
  Family("raw_six", AF_INET6, SOCK_RAW, IPPROTO_ICMPV6);
  Family("bluetooth", 31, SOCK_STREAM, 0);
  Family("alg", 38, SOCK_SEQPACKET, 0);
  Family("can", 29, SOCK_RAW, 1);
  Family("tipc", 30, SOCK_RDM, 0);
  Family("xdp", 44, SOCK_RAW, 0);
  BecomeHonest();
}
