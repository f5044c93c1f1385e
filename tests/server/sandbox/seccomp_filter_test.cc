// The policy's system call filter from the shipped config, loaded into processes that try what it
// denies.
#include "server/sandbox/sandbox_config.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <netinet/in.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/personality.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace myograde::server {
namespace {

const PolicySandboxConfig& Shipped() {
  static const PolicySandboxConfig config =
      LoadSandboxConfig(std::string(MYOGRADE_SOURCE_DIR) + "/configs").value().policy;
  return config;
}

std::vector<sock_filter> Program(const Fd& filter) {
  struct stat facts;
  EXPECT_EQ(fstat(filter.get(), &facts), 0);
  std::vector<sock_filter> program(static_cast<size_t>(facts.st_size) / sizeof(sock_filter));
  EXPECT_EQ(pread(filter.get(), program.data(), static_cast<size_t>(facts.st_size), 0),
            facts.st_size);
  return program;
}

// The result of `work` in a process behind the shipped filter: below 200.
int Behind(const std::function<int()>& work) {
  const absl::StatusOr<Fd> filter = MakeSeccompFilter(Shipped());
  EXPECT_TRUE(filter.ok()) << filter.status();
  std::vector<sock_filter> program = Program(*filter);
  const sock_fprog loaded = {static_cast<uint16_t>(program.size()), program.data()};
  const pid_t child = fork();
  if (child == 0) {
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0, &loaded) != 0) {
      _exit(200);
    }
    _exit(work());
  }
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 300 + status;
}

// The error of a call: 0 if it succeeded.
int ErrorOf(long result) { return result >= 0 ? 0 : errno; }

int Denies(long number, uint64_t a = 0, uint64_t b = 0, uint64_t c = 0) {
  return Behind([=] { return ErrorOf(syscall(number, a, b, c, 0, 0, 0)); });
}

TEST(SeccompFilter, DeniesEveryCallThatTheConfigNames) {
  // Arguments that no kernel would act on, should the filter let a call through.
  constexpr uint64_t kNonsense = ~uint64_t{0};
  for (const std::string& name : Shipped().denied_system_calls) {
    const int number = seccomp_syscall_resolve_name(name.c_str());
    if (number < 0) continue;  // of another architecture
    EXPECT_EQ(Denies(number, kNonsense, kNonsense, kNonsense), EPERM) << name;
  }
  for (const std::string& name : Shipped().unimplemented_system_calls) {
    EXPECT_EQ(Denies(seccomp_syscall_resolve_name(name.c_str()), kNonsense, kNonsense), ENOSYS)
        << name;
  }
}

TEST(SeccompFilter, DeniesNewNamespacesThroughClone) {
  for (const uint64_t flag : {CLONE_NEWUSER, CLONE_NEWNS, CLONE_NEWPID, CLONE_NEWNET,
                              CLONE_NEWIPC, CLONE_NEWUTS, CLONE_NEWCGROUP}) {
    EXPECT_EQ(Denies(SYS_clone, flag | SIGCHLD), EPERM) << flag;
    EXPECT_EQ(Denies(SYS_clone, CLONE_NEWUSER | flag | SIGCHLD), EPERM) << flag;
  }
}

TEST(SeccompFilter, LeavesOnlyPlainSockets) {
  const auto socket_error = [](uint64_t family, uint64_t type, uint64_t protocol) {
    return Denies(SYS_socket, family, type, protocol);
  };
  for (const uint64_t family : {AF_VSOCK, AF_NETLINK, AF_PACKET, AF_KEY, AF_ALG, AF_BLUETOOTH,
                                AF_CAN, AF_TIPC, AF_RDS, AF_XDP, AF_UNSPEC}) {
    EXPECT_EQ(socket_error(family, SOCK_DGRAM, 0), EPERM) << family;
    EXPECT_EQ(socket_error(uint64_t{1} << 32 | family, SOCK_DGRAM, 0), EPERM) << family;
  }
  for (const uint64_t type : {SOCK_RAW, SOCK_PACKET, SOCK_RDM, SOCK_DCCP}) {
    EXPECT_EQ(socket_error(AF_INET, type, 0), EPERM) << type;
    EXPECT_EQ(socket_error(AF_INET6, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), EPERM) << type;
  }
  const std::vector<uint64_t> protocols = {IPPROTO_ICMP,    IPPROTO_IGMP, IPPROTO_SCTP,
                                           IPPROTO_UDPLITE, IPPROTO_RAW,  262 /* MPTCP */};
  for (const uint64_t protocol : protocols) {
    EXPECT_EQ(socket_error(AF_INET, SOCK_DGRAM, protocol), EPERM) << protocol;
  }
  EXPECT_EQ(socket_error(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, IPPROTO_UDP), 0);
  EXPECT_EQ(socket_error(AF_INET, SOCK_STREAM, 0), 0);
  EXPECT_EQ(socket_error(AF_UNIX, SOCK_SEQPACKET, 0), 0);
}

TEST(SeccompFilter, DeniesWhatAnArgumentMakesDangerous) {
  const int null = open("/dev/null", O_RDONLY | O_CLOEXEC);
  const auto fd = static_cast<uint64_t>(null);
  EXPECT_EQ(Denies(SYS_ioctl, fd, TIOCSTI), EPERM);
  EXPECT_EQ(Denies(SYS_ioctl, fd, uint64_t{1} << 32 | TIOCSTI), EPERM);
  EXPECT_EQ(Denies(SYS_ioctl, fd, TIOCLINUX), EPERM);
  EXPECT_EQ(Denies(SYS_ioctl, fd, TCGETS), ENOTTY);
  EXPECT_EQ(Denies(SYS_fcntl, fd, F_NOTIFY, 1), EPERM);
  EXPECT_EQ(Denies(SYS_fcntl, fd, F_SETLEASE, F_RDLCK), EPERM);
  for (const uint64_t command : {F_GETLK, F_OFD_GETLK, F_GET_RW_HINT, F_SET_RW_HINT}) {
    EXPECT_EQ(Denies(SYS_fcntl, fd, command), EPERM) << command;
  }
  EXPECT_EQ(Denies(SYS_fcntl, fd, F_GETFL), 0);
  EXPECT_EQ(Denies(SYS_prctl, 62 /* PR_SCHED_CORE */), EPERM);
  EXPECT_EQ(Denies(SYS_prctl, 67 /* PR_SET_MEMORY_MERGE */, 1), EPERM);
  EXPECT_EQ(Denies(SYS_prctl, PR_GET_DUMPABLE), 0);
  const std::vector<uint64_t> domains = {
      PER_SVR4, PER_BSD, READ_IMPLIES_EXEC, MMAP_PAGE_ZERO, ADDR_COMPAT_LAYOUT, 0x80000000,
      0xfffffffe};
  for (const uint64_t domain : domains) {
    EXPECT_EQ(Denies(SYS_personality, domain), EPERM) << domain;
  }
  EXPECT_EQ(Denies(SYS_personality, 0xffffffff), 0);
  EXPECT_EQ(Denies(SYS_personality, ADDR_NO_RANDOMIZE), 0);
  close(null);
}

TEST(SeccompFilter, TakesRecordLocksAndForgetsThem) {
  // The kernel would report a wrong descriptor.
  for (const uint64_t command : {F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW}) {
    EXPECT_EQ(Denies(SYS_fcntl, 9999, command), 0) << command;
    EXPECT_EQ(Denies(SYS_fcntl, 9999, uint64_t{1} << 32 | command), 0) << command;
  }
  EXPECT_EQ(Denies(SYS_fcntl, 9999, F_GETFD), EBADF);
}

TEST(SeccompFilter, KeepsTheUsualBuffersOfASocket) {
  const auto size_after = [](int option) {
    const int socket_fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    int before = 0, after = 0;
    const int wanted = 30000;
    socklen_t size = sizeof(before);
    getsockopt(socket_fd, SOL_SOCKET, option, &before, &size);
    // The call reports success, as it does above the host's limit.
    if (setsockopt(socket_fd, SOL_SOCKET, option, &wanted, sizeof(wanted)) != 0) return 1;
    getsockopt(socket_fd, SOL_SOCKET, option, &after, &size);
    return before == after ? 0 : 2;
  };
  for (const int option : {SO_RCVBUF, SO_SNDBUF}) {
    EXPECT_EQ(size_after(option), 2) << option;
    EXPECT_EQ(Behind([&] { return size_after(option); }), 0) << option;
  }
  EXPECT_EQ(Behind([] {
              const int socket_fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
              const int value = 1;
              if (setsockopt(socket_fd, SOL_SOCKET, SO_REUSEADDR, &value, sizeof(value)) != 0 ||
                  setsockopt(socket_fd, IPPROTO_IP, IP_MULTICAST_TTL, &value, sizeof(value)) != 0) {
                return errno;
              }
              return setsockopt(socket_fd, SOL_SOCKET, 73 /* SO_RESERVE_MEM */, &value,
                                sizeof(value)) == 0 ? 0 : errno;
            }),
            EPERM);
}

TEST(SeccompFilter, HasNoHugePagesOfTheHost) {
  // The kernel's own answer to no length, or no name, differs.
  EXPECT_EQ(Behind([] {
              const auto error = [](int flags) {
                return ErrorOf(
                    syscall(SYS_mmap, 0, 0, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | flags, -1, 0));
              };
              return error(MAP_HUGETLB) == ENOMEM && error(0) == EINVAL ? 0 : 1;
            }),
            0);
  EXPECT_EQ(Denies(SYS_memfd_create, 1, MFD_HUGETLB), ENOMEM);
  EXPECT_EQ(Denies(SYS_memfd_create, 1, MFD_CLOEXEC), EFAULT);
}

TEST(SeccompFilter, TakesHintsAboutMemoryAndForgetsThem) {
  // The kernel would report a wrong descriptor or address.
  EXPECT_EQ(Denies(SYS_fadvise64, 9999, 0, 0), 0);
  EXPECT_EQ(Denies(SYS_readahead, 9999), 0);
  for (const uint64_t advice : {MADV_COLD, MADV_PAGEOUT, MADV_MERGEABLE}) {
    EXPECT_EQ(Denies(SYS_madvise, 1, 4096, advice), 0) << advice;
  }
  EXPECT_EQ(Denies(SYS_mbind, 1, 4096, 99), 0);
  EXPECT_EQ(Denies(SYS_madvise, 1, 4096, MADV_HUGEPAGE), EINVAL);
}

TEST(SeccompFilter, ReadsVectorsWithoutTheCallThatTakesFlags) {
  EXPECT_EQ(Behind([] {
              const int zero = open("/dev/zero", O_RDONLY | O_CLOEXEC);
              char bytes[4];
              iovec vector = {bytes, sizeof(bytes)};
              if (preadv2(zero, &vector, 1, 0, 0) != 4) return 1;
              return preadv2(zero, &vector, 1, 0, RWF_NOWAIT) == -1 ? 0 : 2;
            }),
            0);
}

// The program's answer to a call of this architecture without arguments: for most free numbers the
// kernel itself returns the same error, and it exempts a few from filters.
uint32_t Verdict(const std::vector<sock_filter>& program, uint32_t number) {
  uint32_t value = 0;
  for (size_t at = 0; at < program.size(); ++at) {
    const sock_filter& step = program[at];
    bool jump = false;
    switch (step.code) {
      case BPF_LD | BPF_W | BPF_ABS:
        value = step.k == offsetof(seccomp_data, nr)     ? number
                : step.k == offsetof(seccomp_data, arch) ? seccomp_arch_native()
                                                         : 0;
        continue;
      case BPF_ALU | BPF_AND | BPF_K: value &= step.k; continue;
      case BPF_JMP | BPF_JA: at += step.k; continue;
      case BPF_RET | BPF_K: return step.k;
      case BPF_JMP | BPF_JEQ | BPF_K: jump = value == step.k; break;
      case BPF_JMP | BPF_JGT | BPF_K: jump = value > step.k; break;
      case BPF_JMP | BPF_JGE | BPF_K: jump = value >= step.k; break;
      case BPF_JMP | BPF_JSET | BPF_K: jump = (value & step.k) != 0; break;
      default: ADD_FAILURE() << "unknown instruction " << step.code; return 0;
    }
    at += jump ? step.jt : step.jf;
  }
  ADD_FAILURE() << "the program ends without an answer";
  return 0;
}

TEST(SeccompFilter, KnowsNoCallNewerThanItsLists) {
  for (const long number : {451L, 460L, 470L, 1000L}) EXPECT_EQ(Denies(number), ENOSYS) << number;
  const absl::StatusOr<Fd> filter = MakeSeccompFilter(Shipped());
  ASSERT_TRUE(filter.ok()) << filter.status();
  const std::vector<sock_filter> program = Program(*filter);
  // Linux 6.1's own calls end at 450, and leave a gap that newer kernels have started to fill.
#if defined(__x86_64__)
  constexpr uint32_t kFirstFree = 335;
#else
  constexpr uint32_t kFirstFree = 295;
#endif
  for (uint32_t number = kFirstFree - 2; number < 600; ++number) {
    const bool known = number < kFirstFree || (number >= 424 && number <= 450);
    const bool unknown = Verdict(program, number) == (SECCOMP_RET_ERRNO | ENOSYS);
    const int listed = static_cast<int>(number);
    const std::unique_ptr<char, void (*)(void*)> name(
        seccomp_syscall_resolve_num_arch(SCMP_ARCH_NATIVE, listed), std::free);
    const auto& hidden = Shipped().unimplemented_system_calls;
    const bool is_hidden = name != nullptr && std::find(hidden.begin(), hidden.end(),
                                                        std::string(name.get())) != hidden.end();
    EXPECT_EQ(unknown, !known || is_hidden) << number;
  }
}

#if defined(__x86_64__)
TEST(SeccompFilter, DeniesOtherArchitectures) {
  EXPECT_NE(Denies(0x40000000L | SYS_getpid), 0);
  // 20 is getpid there; it must be denied.
  EXPECT_EQ(Behind([] {
              long result = 20;
              asm volatile("int $0x80" : "+a"(result) : : "memory");
              return result < 0 ? static_cast<int>(-result) : 0;
            }),
            EPERM);
}
#endif

TEST(SeccompFilter, LetsOrdinaryProgramsRun) {
  EXPECT_EQ(Behind([] {
              // Threads and processes, through clone instead of clone3.
              int value = 0;
              std::thread([&value] { value = 7; }).join();
              const pid_t child = fork();
              if (child == 0) _exit(value);
              int status = 0;
              return waitpid(child, &status, 0) == child ? WEXITSTATUS(status) - 7 : 1;
            }),
            0);
}

TEST(SeccompFilter, NamesACallThatDoesNotExist) {
  PolicySandboxConfig config = Shipped();
  config.denied_system_calls.push_back("no_such_call");
  const absl::StatusOr<Fd> filter = MakeSeccompFilter(config);
  ASSERT_TRUE(absl::IsInvalidArgument(filter.status()));
  EXPECT_NE(filter.status().message().find("no_such_call"), absl::string_view::npos);
}

}  // namespace
}  // namespace myograde::server
