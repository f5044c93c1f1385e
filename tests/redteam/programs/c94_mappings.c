// Exits at the head of a chain of children that each have 15,000 mappings to be torn down.
#include <sys/mman.h>
#include <unistd.h>

enum { kMappings = 15000, kPage = 4096 };

int main(void) {
  char* memory = mmap(NULL, (size_t)kMappings * kPage, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return 1;
  // Adjacent mappings with the same protection would be merged.
  for (int i = 0; i < kMappings; i += 2) mprotect(memory + (size_t)i * kPage, kPage, PROT_NONE);
  for (int i = 0; i < 60; ++i) {
    const pid_t child = fork();
    if (child > 0 && i > 0) pause();
    if (child > 0) {
      sleep(2);
      return 0;
    }
  }
  pause();
  return 0;
}
