// Preloaded into a daemon by crash_test.py: kills the process just before or just after its Nth
// flush to disk; flushes are its store's commits. KILL_AT_SYNC is "before:N" or "after:N".
#include <dlfcn.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>

namespace {

std::atomic<int> syncs = 0;

int Sync(const char* name, int fd) {
  const auto real = reinterpret_cast<int (*)(int)>(dlsym(RTLD_NEXT, name));
  const char* when = std::getenv("KILL_AT_SYNC");
  const char* colon = when == nullptr ? nullptr : std::strchr(when, ':');
  const bool now = colon != nullptr && ++syncs == std::atoi(colon + 1);
  if (now && when[0] == 'b') kill(getpid(), SIGKILL);
  const int result = real(fd);
  if (now) kill(getpid(), SIGKILL);
  return result;
}

}  // namespace

extern "C" int fsync(int fd) { return Sync("fsync", fd); }
extern "C" int fdatasync(int fd) { return Sync("fdatasync", fd); }
