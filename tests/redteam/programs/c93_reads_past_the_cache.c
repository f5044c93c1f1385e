// Exits while 60 children are in large reads past the page cache, where SIGKILL takes effect late.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

enum { kBytes = 1 << 20 };

static void ReadForEver(void) {
  const int file = open("/usr/bin/python3", O_RDONLY | O_DIRECT);
  void* memory = mmap(NULL, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (file < 0 || memory == MAP_FAILED) _exit(1);
  for (;;) {
    for (off_t at = 0; pread(file, memory, kBytes, at) > 0; at += kBytes) continue;
  }
}

int main(void) {
  for (int i = 0; i < 60; ++i) {
    if (fork() == 0) ReadForEver();
  }
  sleep(1);
  return 0;
}
