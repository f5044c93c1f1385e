// A file of 64 GiB, most of it holes: mapped and touched ("mapped"), or written at ever
// larger offsets ("written").
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static const off_t kSize = (off_t)64 << 30;
// Below any limit on one file's size; many of these exceed the limit on all.
static const off_t kPart = (off_t)16 << 20;

static void WriteFar(void) {
  const int fd = open("/tmp/far", O_CREAT | O_RDWR, 0600);
  for (off_t at = 4096; at < kSize; at *= 2) {
    if (pwrite(fd, "x", 1, at) != 1) break;
  }
  fprintf(stderr, "RT refused %s\n", strerrorname_np(errno));
  abort();
}

static void TouchMapped(void) {
  for (int i = 0;; ++i) {
    char path[32];
    snprintf(path, sizeof(path), "/tmp/sparse%d", i);
    const int fd = open(path, O_CREAT | O_RDWR, 0600);
    if (fd < 0 || ftruncate(fd, kPart) != 0) abort();
    volatile char* at = mmap(NULL, (size_t)kPart, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (at == MAP_FAILED) abort();
    for (off_t j = 0; j < kPart; j += 4096) at[j] = 1;
    close(fd);
  }
}

int main(int argc, char** argv) {
  if (argc == 2 && strcmp(argv[1], "written") == 0) WriteFar();
  TouchMapped();
}
