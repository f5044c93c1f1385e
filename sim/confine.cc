#include "sim/confine.h"

#include <fcntl.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string_view>

#include <absl/strings/str_cat.h>

namespace myograde::sim {
namespace {

// No config can allow these: without any one of them the filter means little.
constexpr std::array kNever = {
    "accept",  "accept4", "bind",   "bpf",    "chroot",  "clone",   "clone3", "connect",
    "creat",   "execve",  "execveat", "fork", "io_uring_setup", "kill", "link", "listen",
    "memfd_create", "mount", "open", "openat", "openat2", "open_by_handle_at", "open_tree",
    "pidfd_getfd", "pidfd_open", "pidfd_send_signal", "pkey_mprotect", "prctl",
    "process_vm_readv", "process_vm_writev", "ptrace", "rename", "renameat", "renameat2",
    "seccomp", "setns", "shmat", "shmget", "socket", "socketpair", "symlink", "symlinkat",
    "tkill", "unlink", "unlinkat", "unshare", "vfork"};

#if defined(__SANITIZE_ADDRESS__)
constexpr std::array kSanitizerCalls = {
    "fcntl",   "fstat",     "getcwd",    "getdents64",   "getrlimit", "ioctl",
    "newfstatat", "pipe",   "pipe2",     "pread64",      "prlimit64", "readlink",
    "readlinkat", "rt_sigaction", "sched_getaffinity", "sigaltstack", "stat", "uname"};
#endif

struct Release {
  void operator()(void* context) const { seccomp_release(context); }
};

int Allow(scmp_filter_ctx filter, const std::string& name, int number) {
  const auto with = [&](scmp_arg_cmp condition) {
    return seccomp_rule_add(filter, SCMP_ACT_ALLOW, number, 1, condition);
  };
  if (name == "mmap" || name == "mprotect") {
    return with(SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  }
  if (name == "tgkill") return with(SCMP_A0(SCMP_CMP_EQ, static_cast<uint64_t>(getpid())));
  if (name == "setsockopt") {
    return seccomp_rule_add(filter, SCMP_ACT_ALLOW, number, 2, SCMP_A1(SCMP_CMP_EQ, SOL_SOCKET),
                            SCMP_A2(SCMP_CMP_EQ, SO_RCVTIMEO));
  }
  return seccomp_rule_add(filter, SCMP_ACT_ALLOW, number, 0);
}

int AllowCompiledCode(scmp_filter_ctx filter) {
  return seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(mprotect), 1,
                          SCMP_A2(SCMP_CMP_EQ, PROT_READ | PROT_EXEC));
}

int AllowSanitizer([[maybe_unused]] scmp_filter_ctx filter) {
  int result = 0;
#if defined(__SANITIZE_ADDRESS__)
  for (const char* name : kSanitizerCalls) {
    result |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, seccomp_syscall_resolve_name(name), 0);
  }
  result |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(open), 1,
                             SCMP_A1(SCMP_CMP_MASKED_EQ, O_ACCMODE | O_CREAT, O_RDONLY));
  result |= seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(openat), 1,
                             SCMP_A2(SCMP_CMP_MASKED_EQ, O_ACCMODE | O_CREAT, O_RDONLY));
#endif
  return result;
}

}  // namespace

absl::Status AllowOnly(const std::vector<std::string>& names, NewCode code) {
  // Ends the whole process: an error code might be taken for a state of the
  // host, and a call that is not needed is never a mistake of a caller.
  const std::unique_ptr<void, Release> filter(seccomp_init(SCMP_ACT_KILL_PROCESS));
  if (filter == nullptr) return absl::InternalError("libseccomp can't allocate a filter");
  int result = seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
  result |= seccomp_attr_set(filter.get(), SCMP_FLTATR_CTL_TSYNC, 1);
  // Kernels before 5.16 slow down the loads and stores of whoever has a filter, unless asked not
  // to. That guards programs that run others' code in their own process; this one does not.
  result |= seccomp_attr_set(filter.get(), SCMP_FLTATR_CTL_SSB, 1);
  for (const std::string& name : names) {
    const int number = seccomp_syscall_resolve_name(name.c_str());
    if (number == __NR_SCMP_ERROR) {
      return absl::InvalidArgumentError(
          absl::StrCat("allowed_system_calls: \"", name, "\" is not a system call; see syscalls(2)"));
    }
    if (std::find(kNever.begin(), kNever.end(), std::string_view(name)) != kNever.end()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "allowed_system_calls: the simulator's filter never allows ", name, "; take it out"));
    }
    result |= Allow(filter.get(), name, number);
  }
  if (code == NewCode::kCompiled) result |= AllowCompiledCode(filter.get());
  result |= AllowSanitizer(filter.get());
  if (result != 0) {
    return absl::InternalError("libseccomp refuses a rule of the simulator's filter");
  }
  if (const int error = seccomp_load(filter.get()); error != 0) {
    return absl::InternalError(
        absl::StrCat("the kernel refuses the simulator's filter: ", strerror(-error)));
  }
  return absl::OkStatus();
}

}  // namespace myograde::sim
