// Tries every descriptor above standard error before it opens any itself.
#include <fcntl.h>

#include "report.h"

int main(void) {
  int open_ones = 0, readable = 0;
  char text[64] = "", byte;
  for (int fd = 3; fd < 1024; ++fd) {
    if (fcntl(fd, F_GETFD) >= 0) {
      ++open_ones;
      const size_t used = strlen(text);
      snprintf(text + used, sizeof(text) - used, "%d,", fd);
    }
    fcntl(fd, F_SETFL, O_NONBLOCK);
    if (read(fd, &byte, 1) >= 0) ++readable;
    if (write(fd, "x", 1) >= 0) ++readable;
  }
  char number[16];
  snprintf(number, sizeof(number), "%d", open_ones);
  ReportText("open_descriptors", number);
  snprintf(number, sizeof(number), "%d", readable);
  ReportText("usable_descriptors", number);
  // Standard input is empty, and none of the three is a terminal.
  ReportText("stdin", read(0, &byte, 1) == 0 ? "empty" : "not-empty");
  ReportText("terminal", isatty(0) || isatty(1) || isatty(2) ? "yes" : "no");
  BecomeHonest();
}
