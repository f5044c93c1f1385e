// Changes who is notified of whose death: subreaper, death signals, dumpable. Tries to let a
// grandchild survive everything else.
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include "report.h"

int main(void) {
  Report("subreaper", prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0));
  Report("no_death_signal", prctl(PR_SET_PDEATHSIG, 0, 0, 0, 0));
  Report("dumpable", prctl(PR_SET_DUMPABLE, 1, 0, 0, 0));
  Report("ptracer_any", prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY, 0, 0, 0));
  for (int i = 0; i < 10; ++i) {
    const pid_t child = fork();
    if (child == 0) {
      setsid();
      if (fork() == 0) {
        prctl(PR_SET_PDEATHSIG, 0, 0, 0, 0);
        for (;;) pause();
      }
      _exit(0);
    }
    waitpid(child, NULL, 0);
  }
  BecomeHonest();
}
