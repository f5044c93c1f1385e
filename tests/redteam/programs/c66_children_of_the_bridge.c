// Makes children whose parent is the bridge, and which exit like a policy.
#include <sched.h>
#include <signal.h>
#include <sys/syscall.h>

#include "report.h"

int main(void) {
  long made = 0;
  for (int i = 0; i < 50; ++i) {
    const long child = syscall(SYS_clone, CLONE_PARENT | SIGCHLD, 0, 0, 0, 0);
    if (child == 0) {
      if (i % 2 == 0) _exit(7);
      kill(getpid(), SIGSEGV);
    }
    made += child > 0;
  }
  ReportText("children", made > 0 ? "made" : "none");
  BecomeHonest();
}
