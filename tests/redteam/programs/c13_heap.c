// Allocates memory and writes to it until there is none.
#include <stdlib.h>
#include <string.h>

static void* volatile last;  // or a compiler leaves out what nobody reads

int main(void) {
  for (;;) {
    void* block = malloc(1 << 20);
    if (block == NULL) abort();
    memset(block, 1, 1 << 20);
    last = block;
  }
}
