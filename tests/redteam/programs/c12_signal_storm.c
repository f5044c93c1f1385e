// Many children that send signals to each other and set timers, to keep any observer busy. Up to
// 512, as many as it gets.
#include <signal.h>
#include <sys/time.h>
#include <unistd.h>

static void Count(int number) { (void)number; }

int main(void) {
  signal(SIGALRM, Count);
  signal(SIGUSR1, Count);
  const struct itimerval often = {{0, 100}, {0, 100}};
  for (int i = 0; i < 512; ++i) {
    if (fork() == 0) {
      setitimer(ITIMER_REAL, &often, NULL);
      for (;;) kill(0, SIGUSR1);
    }
  }
  for (;;) kill(0, SIGUSR1);
}
