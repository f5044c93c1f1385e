// CPU time of processes without a control group, to the nanosecond.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>

#include "server/sandbox/sandbox.h"

namespace myograde::server {
namespace {

int64_t OwnCpuNs() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return time.tv_sec * int64_t{1000000000} + time.tv_nsec;
}

// A process that has used at least 3 ms, less than a tick of /proc/PID/stat,
// and a child of its own that has used 2 ms. Both stay until they are killed.
struct Family {
  Family() {
    int words[2];
    if (pipe(words) != 0) return;
    root = fork();
    if (root == 0) {
      setpgid(0, 0);
      while (OwnCpuNs() < 3000000) continue;
      if (fork() == 0) {
        while (OwnCpuNs() < 2000000) continue;
        const int64_t used = OwnCpuNs();
        (void)!write(words[1], &used, sizeof(used));
      }
      while (true) pause();
    }
    close(words[1]);
    told = read(words[0], &childs_ns, sizeof(childs_ns)) == sizeof(childs_ns);
    close(words[0]);
  }
  ~Family() {
    if (root > 0) {
      kill(-root, SIGKILL);
      waitpid(root, nullptr, 0);
    }
  }

  pid_t root = -1;
  bool told = false;
  int64_t childs_ns = 0;
};

TEST(ProcessTreeCpuNs, CountsWhatIsLessThanATickAndWhatChildrenUse) {
  const Family family;
  ASSERT_TRUE(family.told);
  EXPECT_GE(ProcessTreeCpuNs(family.root), 3000000 + family.childs_ns);
}

TEST(ProcessTreeCpuNs, OfWhatIsNotThereIsNothing) {
  const pid_t gone = fork();
  if (gone == 0) _exit(0);
  ASSERT_EQ(waitpid(gone, nullptr, 0), gone);
  EXPECT_EQ(ProcessTreeCpuNs(gone), 0);
}

}  // namespace
}  // namespace myograde::server
