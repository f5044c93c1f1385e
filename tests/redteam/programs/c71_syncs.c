// Makes the host flush its disks again and again.
#include <fcntl.h>
#include <time.h>

#include "report.h"

static time_t Seconds(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec;
}

int main(void) {
  for (int i = 0; i < 4; ++i) {
    if (fork() == 0) {
      const time_t end = Seconds() + 3;
      while (Seconds() < end) {
        sync();
        const int fd = open("/tmp/synced", O_CREAT | O_WRONLY, 0600);
        if (write(fd, "x", 1) == 1) fsync(fd);
        close(fd);
      }
      _exit(0);
    }
  }
  BecomeHonest();
}
