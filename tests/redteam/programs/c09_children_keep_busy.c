// Exits at once with status 0, while 100 children keep computing.
#include <signal.h>
#include <unistd.h>

int main(void) {
  signal(SIGHUP, SIG_IGN);
  for (int i = 0; i < 100; ++i) {
    if (fork() == 0) {
      setsid();
      for (volatile unsigned long work = 0;; ++work) continue;
    }
  }
  sleep(1);
  return 0;
}
