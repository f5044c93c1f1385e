// Attacks process 1 through a descriptor of it.
#include <signal.h>
#include <sys/resource.h>
#include <sys/syscall.h>

#include "report.h"

int main(void) {
  const int first = (int)syscall(SYS_pidfd_open, 1, 0);
  for (int number = 1; number < 65; ++number) {
    syscall(SYS_pidfd_send_signal, first, number, NULL, 0);
  }
  for (int fd = 0; fd < 64; ++fd) {
    if (syscall(SYS_pidfd_getfd, first, fd, 0) >= 0) ReportText("stolen_descriptor", "allowed");
  }
  Report("limit_more", prlimit(0, RLIMIT_NOFILE, &(struct rlimit){1 << 20, 1 << 20}, NULL));
  Report("slow_first", setpriority(PRIO_PROCESS, 1, 19));
  ReportText("survived", "yes");
  // Last of all, as it may end the bridge and with it everything here.
  const struct rlimit none = {0, 0};
  prlimit(1, RLIMIT_NOFILE, &none, NULL);
  BecomeHonest();
}
