// Forks for ever, and its children do.
#include <unistd.h>

int main(void) {
  for (;;) {
    if (fork() < 0) usleep(1000);
  }
}
