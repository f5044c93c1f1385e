// Creates threads until it gets no more, and keeps trying.
#include <pthread.h>
#include <unistd.h>

static void* Idle(void* unused) {
  for (;;) pause();
  return unused;
}

int main(void) {
  pthread_attr_t small;
  pthread_attr_init(&small);
  pthread_attr_setstacksize(&small, 16384);
  for (;;) {
    pthread_t thread;
    if (pthread_create(&thread, &small, Idle, NULL) != 0) usleep(1000);
  }
}
