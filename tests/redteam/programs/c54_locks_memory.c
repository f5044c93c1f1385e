// Locks memory, so that the kernel could not reclaim it.
#include <sys/mman.h>
#include <sys/resource.h>

#include "report.h"

int main(void) {
  const struct rlimit unlimited = {RLIM_INFINITY, RLIM_INFINITY};
  Report("unlimited", setrlimit(RLIMIT_MEMLOCK, &unlimited));
  const size_t size = 1u << 30;
  const int flags = MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE;
  char* block = mmap(NULL, size, PROT_READ | PROT_WRITE, flags, -1, 0);
  Report("pinned", block == MAP_FAILED ? -1 : mlock(block, size));
  BecomeHonest();
}
