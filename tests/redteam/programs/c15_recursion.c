// Endless recursion, on the stack as it is ("plain") or without its limit ("unlimited").
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

static int Deeper(volatile char* above) {
  volatile char frame[4096];
  frame[0] = above != NULL ? (char)(above[0] + 1) : 1;
  return Deeper(frame) + frame[0];
}

int main(int argc, char** argv) {
  const struct rlimit unlimited = {RLIM_INFINITY, RLIM_INFINITY};
  if (argc == 2 && strcmp(argv[1], "unlimited") == 0 &&
      setrlimit(RLIMIT_STACK, &unlimited) == 0) {
    execl("/proc/self/exe", argv[0], "again", (char*)NULL);
  }
  return Deeper(NULL);
}
