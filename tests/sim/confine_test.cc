// What the simulator can still do behind its filter, each thing tried in a
// process of its own: it works, or the kernel ends that process with SIGSYS.
#include "sim/confine.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include <absl/strings/str_format.h>

#include "protocol/base/config_reader.h"
#include "protocol/lease/sim_channel.h"

namespace myograde::sim {
namespace {

constexpr int kWorked = 0;
constexpr int kFailed = 1;
constexpr int kNoFilter = 2;

const std::vector<std::string>& ShippedCalls() {
  static const std::vector<std::string> calls = [] {
    const auto json =
        ReadJsonFile(std::string(MYOGRADE_SOURCE_DIR) + "/configs/sandbox/sim.json");
    return json.value()["allowed_system_calls"].get<std::vector<std::string>>();
  }();
  return calls;
}

// The wait status of a process that sets the shipped filter and does `work`.
int Behind(const std::function<bool()>& work, NewCode code = NewCode::kNone) {
  const pid_t child = fork();
  if (child == 0) {
    if (!AllowOnly(ShippedCalls(), code).ok()) _exit(kNoFilter);
    _exit(work() ? kWorked : kFailed);
  }
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return status;
}

void ExpectWorks(const char* what, const std::function<bool()>& work) {
  const int status = Behind(work);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == kWorked)
      << what << ": wait status " << status;
}

void ExpectEnds(const char* what, const std::function<bool()>& work) {
  const int status = Behind(work);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS)
      << what << ": wait status " << status;
}

TEST(Confine, LetsTheSimulatorComputeTalkAndEnd) {
  int pair[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair), 0);
  ExpectWorks("memory", [] {
    for (const size_t size : {size_t{100}, size_t{1} << 20, size_t{200} << 20}) {
      std::vector<char> memory(size, 'x');
      memory.resize(2 * size);
      if (memory[size - 1] != 'x') return false;
    }
    return true;
  });
  ExpectWorks("exceptions and texts", [] {
    try {
      throw std::runtime_error(absl::StrFormat("%.3f of %s", 1.5, std::strerror(EINVAL)));
    } catch (const std::runtime_error& error) {
      return std::string(error.what()).starts_with("1.500 of ");
    }
  });
  ExpectWorks("the runner's channel", [&] {
    if (!SendSimMessage(pair[0], {{"type", "progress"}}, STDERR_FILENO).ok()) return false;
    const auto message = ReceiveSimMessage(pair[1], absl::Seconds(5));
    if (!message.ok() || !message->fd.valid()) return false;
    return absl::IsDeadlineExceeded(ReceiveSimMessage(pair[1], absl::Milliseconds(5)).status());
  });
  ExpectWorks("a receive timeout", [&] {
    const timeval slice = {0, 1000};
    char byte;
    return setsockopt(pair[0], SOL_SOCKET, SO_RCVTIMEO, &slice, sizeof(slice)) == 0 &&
           recv(pair[0], &byte, 1, 0) < 0 && errno == EAGAIN;
  });
  ExpectWorks("sorting more than a little, which asks for the size of the memory", [] {
    std::vector<double> numbers(10000);
    for (size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<double>(i * 7919 % 10000);
    qsort(numbers.data(), numbers.size(), sizeof(double), [](const void* a, const void* b) {
      const double difference = *static_cast<const double*>(a) - *static_cast<const double*>(b);
      return difference < 0 ? -1 : difference > 0;
    });
    return std::is_sorted(numbers.begin(), numbers.end());
  });
  ExpectWorks("last words", [] { return std::fprintf(stderr, "%s", "") == 0; });
  close(pair[0]);
  close(pair[1]);
}

TEST(Confine, LeavesAbortItsOwnSignal) {
  const int status = Behind([]() -> bool { std::abort(); });
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT) << status;
}

TEST(Confine, EndsAProcessThatReachesOut) {
  const std::map<const char*, std::function<bool()>> tries = {
      {"execve", [] { return execl("/bin/true", "true", nullptr) == 0; }},
      {"execveat", [] { return syscall(SYS_execveat, 0, "", nullptr, nullptr, 0) == 0; }},
      {"fork", [] { return fork() >= 0; }},
      {"vfork", [] { return syscall(SYS_vfork) >= 0; }},
      {"clone3", [] { return syscall(SYS_clone3, nullptr, 0) == 0; }},
      {"thread", [] {
         pthread_t thread;
         return pthread_create(&thread, nullptr, [](void*) -> void* { return nullptr; },
                               nullptr) == 0;
       }},
      {"open", [] { return syscall(SYS_open, "/dev/null", O_WRONLY) >= 0; }},
      {"openat", [] { return open("/dev/null", O_RDWR) >= 0; }},
      {"openat2", [] { return syscall(SYS_openat2, AT_FDCWD, "/", nullptr, 0) >= 0; }},
      {"creat", [] { return syscall(SYS_creat, "/tmp/confine", 0600) >= 0; }},
      {"unlink", [] { return unlink("/tmp/confine") == 0; }},
      {"memfd", [] { return memfd_create("x", 0) >= 0; }},
      {"socket", [] { return socket(AF_INET, SOCK_DGRAM, 0) >= 0; }},
      {"socketpair", [] {
         int ends[2];
         return socketpair(AF_UNIX, SOCK_STREAM, 0, ends) == 0;
       }},
      {"connect", [] { return connect(0, nullptr, 0) == 0; }},
      {"another socket option", [] {
         const int one = 1;
         return setsockopt(0, SOL_SOCKET, SO_BROADCAST, &one, sizeof(one)) == 0;
       }},
      {"ptrace", [] { return ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) == 0; }},
      {"process_vm_readv", [] { return syscall(SYS_process_vm_readv, 1, 0, 0, 0, 0, 0) == 0; }},
      {"kill", [] { return kill(getppid(), 0) == 0; }},
      {"tgkill of another", [] { return syscall(SYS_tgkill, getpid() + 1, 1, 0) == 0; }},
      {"prctl", [] { return prctl(PR_SET_DUMPABLE, 1) == 0; }},
      {"unshare", [] { return unshare(CLONE_NEWUSER) == 0; }},
      {"io_uring", [] { return syscall(SYS_io_uring_setup, 1, nullptr) >= 0; }},
      {"executable mmap", [] {
         return mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) !=
                MAP_FAILED;
       }},
      {"executable mprotect", [] {
         alignas(4096) static char page[4096];
         return mprotect(page, sizeof(page), PROT_READ | PROT_EXEC) == 0;
       }}};
  for (const auto& [what, work] : tries) ExpectEnds(what, work);
}

// A renderer compiles what it draws with.
TEST(Confine, LetsCompiledCodeBeExecutableButNeverWritableAsWell) {
  alignas(4096) static char page[4096];
  const auto protect = [](int protection) {
    return [protection] { return mprotect(page, sizeof(page), protection) == 0; };
  };
  EXPECT_EQ(Behind(protect(PROT_READ | PROT_EXEC), NewCode::kCompiled), kWorked);
  EXPECT_EQ(Behind(protect(PROT_READ), NewCode::kCompiled), kWorked);
  for (const int protection : {PROT_READ | PROT_WRITE | PROT_EXEC, PROT_EXEC}) {
    const int status = Behind(protect(protection), NewCode::kCompiled);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS) << status;
  }
}

#if defined(__x86_64__)
TEST(Confine, EndsAProcessThatSpeaksAnotherArchitecture) {
  ExpectEnds("x32", [] { return syscall(0x40000000 | SYS_getpid) > 0; });
  ExpectEnds("32-bit", [] {
    long result = 20;  // getpid there
    asm volatile("int $0x80" : "+a"(result) : : "memory");
    return result > 0;
  });
}
#endif

TEST(Confine, RefusesAListThatWouldUndoIt) {
  for (const char* name : {"execve", "fork", "clone", "clone3", "openat", "socket", "ptrace"}) {
    const absl::Status status = AllowOnly({"read", name});
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << name;
    EXPECT_NE(status.message().find(name), absl::string_view::npos) << status;
  }
  const absl::Status unknown = AllowOnly({"read", "no_such_call"});
  EXPECT_TRUE(absl::IsInvalidArgument(unknown));
  EXPECT_NE(unknown.message().find("no_such_call"), absl::string_view::npos);
  // Nothing was set by any of them.
  EXPECT_GE(dup(STDERR_FILENO), 0);
}

}  // namespace
}  // namespace myograde::sim
