// Several processes open as many sockets as they may and fill them: in one multicast group, where
// each datagram is counted once per member; one by one; or as streams that nobody reads.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "report.h"

enum { kProcesses = 16, kSockets = 2000, kPorts = 20 };

static struct sockaddr_in Place(const char* address, int port) {
  struct sockaddr_in place = {.sin_family = AF_INET, .sin_port = htons((unsigned short)port)};
  inet_pton(AF_INET, address, &place.sin_addr);
  return place;
}

static void Datagrams(const char* address, int join) {
  static char packet[60000];
  const int on = 1;
  const int sender = socket(AF_INET, SOCK_DGRAM, 0);
  for (int i = 0; i < kSockets; ++i) {
    const int fd = socket(AF_INET, SOCK_DGRAM, 0);
    if (fd < 0) break;
    const int size = 64 << 20;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &size, sizeof(size));
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    struct sockaddr_in place = Place(address, join ? 7000 + i % kPorts : 0);
    socklen_t length = sizeof(place);
    bind(fd, (struct sockaddr*)&place, sizeof(place));
    getsockname(fd, (struct sockaddr*)&place, &length);
    const struct ip_mreq group = {place.sin_addr, {0}};
    if (join) setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof(group));
    for (int k = 0; k < 4 && !join; ++k) {
      sendto(sender, packet, sizeof(packet), 0, (struct sockaddr*)&place, sizeof(place));
    }
  }
  for (int port = 0;; port = (port + 1) % kPorts) {
    const struct sockaddr_in place = Place(address, 7000 + port);
    sendto(sender, packet, sizeof(packet), MSG_DONTWAIT, (const struct sockaddr*)&place,
           sizeof(place));
  }
}

static void Streams(void) {
  static char bytes[65536];
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  struct sockaddr_in place = Place("127.0.0.1", 0);
  socklen_t length = sizeof(place);
  bind(listener, (struct sockaddr*)&place, sizeof(place));
  getsockname(listener, (struct sockaddr*)&place, &length);
  listen(listener, 1000);
  for (int i = 0; i < kSockets; ++i) {
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    if (fd < 0 || connect(fd, (struct sockaddr*)&place, sizeof(place)) != 0) break;
    while (send(fd, bytes, sizeof(bytes), MSG_DONTWAIT) > 0) continue;
  }
  for (;;) pause();
}

int main(int argc, char** argv) {
  const char* way = argc > 1 ? argv[1] : "";
  for (int child = 0; child < kProcesses; ++child) {
    if (fork() != 0) continue;
    if (strcmp(way, "streams") == 0) Streams();
    if (strcmp(way, "group") == 0) Datagrams("239.255.1.1", 1);
    Datagrams("127.0.0.1", 0);
  }
  BecomeHonest();
}
