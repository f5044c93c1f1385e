#include "server/sandbox/sandbox_config.h"

#include <fcntl.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/personality.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <map>
#include <memory>

#include <absl/strings/str_cat.h>
#include <seccomp.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// A list of system calls. An empty list or an unknown name is an error, as a filter that lacks a
// call because of a typo looks like any other.
std::vector<std::string> SystemCalls(ConfigReader& reader, const char* key) {
  std::vector<std::string> names = reader.Strings(key);
  if (names.empty()) reader.Fail(key, "must have at least one system call");
  for (const std::string& name : names) {
    if (seccomp_syscall_resolve_name(name.c_str()) != __NR_SCMP_ERROR) continue;
    reader.Fail(key,
                absl::StrCat("holds \"", name, "\", which is not a system call; see syscalls(2)"));
  }
  return names;
}

absl::StatusOr<PolicySandboxConfig> LoadPolicy(const std::string& path) {
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  ConfigReader reader(json, path);
  PolicySandboxConfig config;
  config.denied_system_calls = SystemCalls(reader, "denied_system_calls");
  config.unimplemented_system_calls = SystemCalls(reader, "unimplemented_system_calls");
  static const std::map<std::string, int> kFamilies = {
      {"unix", AF_UNIX}, {"inet", AF_INET}, {"inet6", AF_INET6}};
  for (const std::string& name : reader.Strings("socket_families")) {
    const auto family = kFamilies.find(name);
    if (family == kFamilies.end()) {
      reader.Fail("socket_families", "may have only \"unix\", \"inet\" and \"inet6\"");
      break;
    }
    config.socket_families.push_back(family->second);
  }
  config.sockets = reader.Integer("sockets", 16, 65536);
  config.all_sockets = reader.Integer("all_sockets", 16, 1048576);
  config.cpu_refresh_s = reader.Number("cpu_refresh_s", {0.001, 1});
  config.kill_s = reader.Number("kill_s", {1, 60});
  config.farewell_s = reader.Number("farewell_s", {0, 10});
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

absl::StatusOr<SimSandboxConfig> LoadSim(const std::string& path) {
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  ConfigReader reader(json, path);
  SimSandboxConfig config;
  config.allowed_system_calls = SystemCalls(reader, "allowed_system_calls");
  config.tasks = reader.Integer("tasks", 4, 1000);
  config.memory_bytes = reader.Integer("memory_bytes", 256 << 20, int64_t{1} << 40);
  config.open_files = reader.Integer("open_files", 32, 65536);
  config.silence_s = reader.Number("silence_s", {2, 3600});
  config.lease_slack_s = reader.Number("lease_slack_s", {1, 86400});
  config.log_bytes = reader.Integer("log_bytes", 1 << 20, 256 << 20);
  RETURN_IF_ERROR(reader.Finish());
  return config;
}

constexpr uint64_t kNamespaceFlags = CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC |
                                     CLONE_NEWUSER | CLONE_NEWPID | CLONE_NEWNET;
// The bits of a socket's type without its flags.
constexpr uint64_t kSocketTypeMask = 0xf;
constexpr uint64_t kLowHalf = 0xffffffff;
// set_mempolicy_home_node, the last system call that was considered for the lists (Linux 6.1).
// Numbers from here on are the same on all architectures.
constexpr uint32_t kNewestKnownCall = 450;
// Below them each architecture had left numbers free, which newer kernels have started to use. (On
// x86-64 335 and 336 are the kernel's own for probes: they bypass filters and kill the caller.)
constexpr uint32_t kLastFreeCall = 423;
#if defined(__x86_64__)
constexpr uint32_t kFirstFreeCall = 335;  // after rseq
#elif defined(__aarch64__)
constexpr uint32_t kFirstFreeCall = 295;  // after kexec_file_load
#else
#error "say which numbers of system calls Linux 6.1 leaves free on this architecture"
#endif
// Not in Debian 12's headers.
constexpr uint64_t kPrSchedCore = 62;
constexpr uint64_t kPrSetMemoryMerge = 67;
constexpr uint64_t kSoReserveMem = 73;

// Whether the low half of argument `number`, which is all that the kernel reads of it, is `value`.
scmp_arg_cmp Is(unsigned number, uint64_t value) {
  return {number, SCMP_CMP_MASKED_EQ, kLowHalf, value};
}
// Whether it has all of these bits.
scmp_arg_cmp Has(unsigned number, uint64_t bits) {
  return {number, SCMP_CMP_MASKED_EQ, bits, bits};
}

// Answers a call whose arguments are like this with an error number; 0: it succeeds and does
// nothing.
template <typename... Conditions>
int Answer(scmp_filter_ctx filter, int error, int call, Conditions... conditions) {
  return seccomp_rule_add(filter, SCMP_ACT_ERRNO(static_cast<uint16_t>(error)), call,
                          sizeof...(conditions), conditions...);
}

absl::Status DenyByName(scmp_filter_ctx filter, const std::vector<std::string>& names, int error) {
  for (const std::string& name : names) {
    const int number = seccomp_syscall_resolve_name(name.c_str());
    if (number == __NR_SCMP_ERROR) {
      return absl::InvalidArgumentError(
          absl::StrCat("policy.json: \"", name, "\" is not a system call; see syscalls(2)"));
    }
    if (const int result = Answer(filter, error, number); result != 0) {
      return absl::InternalError(
          absl::StrCat("the system call filter refuses ", name, ": ", strerror(-result)));
    }
  }
  return absl::OkStatus();
}

// Denies sockets of families, types and protocols that are not listed, with one rule for each gap
// between them. Each of these can make the kernel load a module.
int DenySockets(scmp_filter_ctx filter, const std::vector<int>& families) {
  int result = 0;
  for (const int call : {SCMP_SYS(socket), SCMP_SYS(socketpair)}) {
    for (uint64_t family = 0; family < AF_MAX; ++family) {
      if (std::find(families.begin(), families.end(), family) != families.end()) continue;
      result |= Answer(filter, EPERM, call, Is(0, family));
    }
    for (uint64_t type = 0; type <= kSocketTypeMask; ++type) {
      if (type == SOCK_STREAM || type == SOCK_DGRAM || type == SOCK_SEQPACKET) continue;
      result |= Answer(filter, EPERM, call, SCMP_A1(SCMP_CMP_MASKED_EQ, kSocketTypeMask, type));
    }
    for (uint64_t protocol = 1; protocol < IPPROTO_UDP; ++protocol) {
      if (protocol == IPPROTO_TCP) continue;
      result |= Answer(filter, EPERM, call, Is(2, protocol));
    }
    result |= Answer(filter, EPERM, call, SCMP_A2(SCMP_CMP_GT, IPPROTO_UDP));
  }
  return result;
}

// Calls that succeed and do nothing. Some are hints, which a program need not check: through the
// page cache of a file below /usr they would write bits for others to read, and evict the host's
// memory at will. Setting a socket's buffers keeps the host's default size, as asking for more than
// the host allows does: their content is memory that no budget counts. So are record locks, and the
// policies that mbind leaves in a file: without a limit on their number, and not counted by control
// groups of version 1.
int PretendTo(scmp_filter_ctx filter) {
  int result = 0;
  for (const int call : {SCMP_SYS(fadvise64), SCMP_SYS(readahead), SCMP_SYS(mbind)}) {
    result |= Answer(filter, 0, call);
  }
  for (const uint64_t advice : {MADV_COLD, MADV_PAGEOUT, MADV_MERGEABLE}) {
    result |= Answer(filter, 0, SCMP_SYS(madvise), Is(2, advice));
  }
  for (const uint64_t command : {F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW}) {
    result |= Answer(filter, 0, SCMP_SYS(fcntl), Is(1, command));
  }
  for (const uint64_t option : {SO_RCVBUF, SO_SNDBUF}) {
    result |= Answer(filter, 0, SCMP_SYS(setsockopt), Is(1, SOL_SOCKET), Is(2, option));
  }
  return result;
}

// Denies execution domains other than Linux, 32-bit Linux and Linux without address randomisation;
// querying the current one (all ones) stays allowed.
int DenyPersonalities(scmp_filter_ctx filter) {
  constexpr uint64_t kTop = 0x80000000;
  int result = 0;
  for (uint64_t bit = 1; bit < kTop; bit <<= 1) {
    result |=
        Answer(filter, EPERM, SCMP_SYS(personality), SCMP_A0(SCMP_CMP_MASKED_EQ, kTop | bit, kTop));
    if (bit == PER_LINUX32 || bit == ADDR_NO_RANDOMIZE) continue;
    result |=
        Answer(filter, EPERM, SCMP_SYS(personality), SCMP_A0(SCMP_CMP_MASKED_EQ, kTop | bit, bit));
  }
  return result;
}

// Calls denied by argument, whatever the config says.
int DenyByArgument(scmp_filter_ctx filter) {
  int result = 0;
  for (uint64_t bit = 1; bit <= kNamespaceFlags; bit <<= 1) {
    if ((kNamespaceFlags & bit) == 0) continue;
    result |= Answer(filter, EPERM, SCMP_SYS(clone), Has(0, bit));
  }
  for (const uint64_t request : {TIOCSTI, TIOCLINUX}) {
    result |= Answer(filter, EPERM, SCMP_SYS(ioctl), Is(1, request));
  }
  // All of these reveal other users of a file that two sandboxes see, such as those below /usr:
  // notifications, leases and locks, and hints that older kernels let anybody write into a file's
  // inode, where they stay.
  for (const uint64_t command : {F_NOTIFY, F_SETLEASE, F_GETLK, F_OFD_GETLK, F_GET_RW_HINT,
                                 F_SET_RW_HINT, F_GET_FILE_RW_HINT, F_SET_FILE_RW_HINT}) {
    result |= Answer(filter, EPERM, SCMP_SYS(fcntl), Is(1, command));
  }
  for (const uint64_t option : {kPrSchedCore, kPrSetMemoryMerge}) {
    result |= Answer(filter, EPERM, SCMP_SYS(prctl), Is(0, option));
  }
  // Huge pages that the host has reserved are memory that no budget counts: act as if there were
  // none. Those that the kernel makes by itself are ordinary memory.
  result |= Answer(filter, ENOMEM, SCMP_SYS(mmap), Has(3, MAP_HUGETLB));
  result |= Answer(filter, ENOMEM, SCMP_SYS(memfd_create), Has(1, MFD_HUGETLB));
  // Reserves memory for a whole pool.
  result |= Answer(filter, EPERM, SCMP_SYS(setsockopt), Is(1, SOL_SOCKET), Is(2, kSoReserveMem));
  return result | DenyPersonalities(filter);
}

// A memory file with `filter`'s program, preceded by a test that answers calls newer than the lists
// with ENOSYS; libseccomp can't express ranges of calls.
absl::StatusOr<Fd> Export(scmp_filter_ctx filter) {
  Fd program(memfd_create("myograde-seccomp", MFD_CLOEXEC));
  if (!program.valid()) {
    return absl::InternalError(absl::StrCat("no memory file: ", strerror(errno)));
  }
  const sock_filter newest[] = {
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, kNewestKnownCall, 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, kLastFreeCall, 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kFirstFreeCall, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS)};
  if (write(program.get(), newest, sizeof(newest)) != static_cast<ssize_t>(sizeof(newest)) ||
      seccomp_export_bpf(filter, program.get()) != 0 || lseek(program.get(), 0, SEEK_SET) != 0) {
    return absl::InternalError("libseccomp can't write the filter");
  }
  return program;
}

}  // namespace

absl::StatusOr<SandboxConfig> LoadSandboxConfig(const std::string& config_dir) {
  ASSIGN_OR_RETURN(PolicySandboxConfig policy, LoadPolicy(config_dir + "/sandbox/policy.json"));
  ASSIGN_OR_RETURN(SimSandboxConfig sim, LoadSim(config_dir + "/sandbox/sim.json"));
  return SandboxConfig{std::move(policy), std::move(sim)};
}

absl::StatusOr<Fd> MakeSeccompFilter(const PolicySandboxConfig& config) {
  const std::unique_ptr<void, void (*)(void*)> filter(seccomp_init(SCMP_ACT_ALLOW),
                                                      seccomp_release);
  if (filter == nullptr) return absl::InternalError("libseccomp can't allocate a filter");
  int result = seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_ERRNO(EPERM));
  RETURN_IF_ERROR(DenyByName(filter.get(), config.denied_system_calls, EPERM));
  RETURN_IF_ERROR(DenyByName(filter.get(), config.unimplemented_system_calls, ENOSYS));
  result |= DenyByArgument(filter.get()) | PretendTo(filter.get()) |
            DenySockets(filter.get(), config.socket_families);
  if (result != 0) return absl::InternalError("libseccomp refuses a rule of the filter");
  return Export(filter.get());
}

}  // namespace myograde::server
