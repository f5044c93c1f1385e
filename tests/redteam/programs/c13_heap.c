// Allocates memory and writes to it until there is none.
#include <stdlib.h>
#include <string.h>

int main(void) {
  for (;;) {
    void* block = malloc(1 << 20);
    if (block == NULL) abort();
    memset(block, 1, 1 << 20);
  }
}
