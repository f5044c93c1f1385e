// Takes timers and queued signals until it gets no more, and keeps them.
#include <signal.h>
#include <time.h>

#include "report.h"

int main(void) {
  sigset_t all;
  sigfillset(&all);
  sigprocmask(SIG_BLOCK, &all, NULL);
  long timers = 0, queued = 0;
  struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGRTMIN};
  timer_t timer;
  while (timers < 1000000 && timer_create(CLOCK_MONOTONIC, &event, &timer) == 0) ++timers;
  Report("more_timers", timers < 1000000 ? -1 : 0);
  const union sigval value = {.sival_int = 1};
  while (queued < 1000000 && sigqueue(getpid(), SIGRTMIN + 1, value) == 0) ++queued;
  Report("more_signals", queued < 1000000 ? -1 : 0);
  const pid_t child = fork();
  if (child == 0) {
    // These stay queued while the honest program plays.
    while (sigqueue(getpid(), SIGRTMIN + 1, value) == 0) continue;
    for (;;) pause();
  }
  sigprocmask(SIG_UNBLOCK, &all, NULL);
  BecomeHonest();
}
