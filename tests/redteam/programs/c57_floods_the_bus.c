// Several processes send datagrams at full rate: to the bus, and to every port of the loopback,
// so to the bridge's own as well.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "report.h"

static void Flood(int child) {
  static char packet[1400] = "LC02\0\0\0\1MYOGRADE_ACTION";
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(7667)};
  inet_pton(AF_INET, child % 2 == 0 ? "239.255.76.67" : "127.0.0.1", &to.sin_addr);
  for (unsigned int port = 1;; ++port) {
    if (child % 2 == 1) to.sin_port = htons((unsigned short)port);
    sendto(fd, packet, child % 3 == 0 ? 24 : sizeof(packet), 0, (struct sockaddr*)&to, sizeof(to));
  }
}

int main(void) {
  for (int child = 0; child < 6; ++child) {
    if (fork() == 0) Flood(child);
  }
  BecomeHonest();
}
