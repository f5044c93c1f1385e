// Keeps half of its memory where version 1 control groups don't count it: in streams between its
// own sockets, which nobody reads. The other half is plain memory.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "report.h"

enum { kPairs = 110, kPlainBytes = 48 << 20 };

static void Fill(int fd) {
  static char bytes[65536];
  while (send(fd, bytes, sizeof(bytes), MSG_DONTWAIT) > 0) continue;
}

static void Hoard(int done) {
  struct sockaddr_in place = {.sin_family = AF_INET};
  socklen_t length = sizeof(place);
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  inet_pton(AF_INET, "127.0.0.1", &place.sin_addr);
  bind(listener, (struct sockaddr*)&place, sizeof(place));
  getsockname(listener, (struct sockaddr*)&place, &length);
  listen(listener, kPairs);
  for (int i = 0; i < kPairs; ++i) {
    const int near = socket(AF_INET, SOCK_STREAM, 0);
    if (connect(near, (struct sockaddr*)&place, sizeof(place)) != 0) break;
    const int far = accept(listener, NULL, NULL);
    Fill(near);
    Fill(far);
  }
  memset(malloc(kPlainBytes), 1, kPlainBytes);
  if (write(done, "x", 1) != 1) return;
  for (;;) pause();
}

int main(void) {
  int done[2];
  char byte;
  if (pipe(done) != 0) return 2;
  if (fork() == 0) Hoard(done[1]);
  close(done[1]);
  // Gives up if its hoard is gone.
  if (read(done[0], &byte, 1) != 1) return 3;
  BecomeHonest();
}
