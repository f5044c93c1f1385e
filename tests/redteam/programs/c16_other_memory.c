// Memory that belongs to no process: tmpfs, memfd, System V segments, message queues. Takes it in
// pieces of 1 MiB until there is no more, then says so and waits.
#include <errno.h>
#include <fcntl.h>
#include <mqueue.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/shm.h>
#include <sys/stat.h>
#include <unistd.h>

enum { kPiece = 1 << 20 };
static char piece[kPiece];

static int FillFile(int fd) {
  while (fd >= 0) {
    if (write(fd, piece, kPiece) < 0) break;
  }
  return errno;
}

static int FillFolder(const char* folder) {
  char path[64];
  snprintf(path, sizeof(path), "%s/full", folder);
  return FillFile(open(path, O_CREAT | O_WRONLY, 0600));
}

static int FillSegments(void) {
  for (;;) {
    const int id = shmget(IPC_PRIVATE, kPiece, IPC_CREAT | 0600);
    if (id < 0) return errno;
    void* at = shmat(id, NULL, 0);
    if (at == (void*)-1) return errno;
    memset(at, 1, kPiece);
  }
}

static int FillQueues(void) {
  for (int i = 0;; ++i) {
    char name[32];
    snprintf(name, sizeof(name), "/redteam%d", i);
    struct mq_attr size = {.mq_maxmsg = 10, .mq_msgsize = 8192};
    const mqd_t queue = mq_open(name, O_CREAT | O_WRONLY | O_NONBLOCK, 0600, &size);
    if (queue == (mqd_t)-1) return errno;
    while (mq_send(queue, piece, 8192, 0) == 0) continue;
  }
}

int main(int argc, char** argv) {
  const char* kind = argc == 2 ? argv[1] : "";
  memset(piece, 1, sizeof(piece));
  int error = 0;
  if (strcmp(kind, "tmp") == 0) error = FillFolder("/tmp");
  if (strcmp(kind, "shm") == 0) error = FillFolder("/dev/shm");
  if (strcmp(kind, "memfd") == 0) error = FillFile((int)memfd_create("full", 0));
  if (strcmp(kind, "sysv") == 0) error = FillSegments();
  if (strcmp(kind, "mq") == 0) error = FillQueues();
  fprintf(stderr, "RT refused %s\n", strerrorname_np(error));
  abort();
}
