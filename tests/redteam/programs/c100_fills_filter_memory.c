// Puts a long packet filter on each of thousands of sockets that belong to no network: the kernel
// compiles each into a limited memory, which system call filters need too.
#include <linux/filter.h>
#include <sys/socket.h>

#include "report.h"

enum { kProcesses = 30, kSockets = 240, kLongest = 1000, kPatienceS = 20 };

static int Attach(int fd, int length) {
  static struct sock_filter code[kLongest];
  for (int i = 0; i < length - 1; ++i) {
    code[i] = (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (unsigned)i % 60);
  }
  code[length - 1] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, 0xffff);
  const struct sock_fprog program = {(unsigned short)length, code};
  return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program));
}

static void Hoard(void) {
  for (int i = 0; i < kSockets; ++i) {
    const int fd = socket(AF_UNIX, SOCK_DGRAM, 0);
    for (int length = kLongest; length > 1 && Attach(fd, length) != 0; length /= 2) continue;
  }
  for (;;) pause();
}

int main(void) {
  for (int child = 0; child < kProcesses; ++child) {
    if (fork() == 0) Hoard();
  }
  // A program that is stopped earlier does not notice.
  sleep(kPatienceS);
  return 1;
}
