// Fills the memory with what belongs to no process, so that the kernel, out of memory, may kill the
// bridge rather than this small program.
#include <fcntl.h>
#include <sys/mman.h>

#include "report.h"

int main(void) {
  static char piece[1 << 16];
  memset(piece, 1, sizeof(piece));
  const int adjust = open("/proc/self/oom_score_adj", O_WRONLY);
  Report("adjust", adjust < 0 ? -1 : write(adjust, "-1000", 5));
  const int first = open("/proc/1/oom_score_adj", O_WRONLY);
  Report("adjust_first", first < 0 ? -1 : write(first, "1000", 4));
  const int fd = memfd_create("full", 0);
  for (;;) {
    if (write(fd, piece, sizeof(piece)) < 0) usleep(1000);
  }
}
