// Forks without end, as do its children.
#include <unistd.h>

int main(void) {
  for (;;) {
    if (fork() < 0) usleep(1000);
  }
}
