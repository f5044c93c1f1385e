// 512 MiB that are allocated before main.
#include <stddef.h>
#include <unistd.h>

static volatile char large[512u << 20];

int main(void) {
  for (size_t i = 0; i < sizeof(large); i += 4096) large[i] = 1;
  for (;;) pause();
}
