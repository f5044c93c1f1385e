#include "server/artefact/confine_unpack.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

// What unpacking and exiting need. Nothing here gives an existing file a new name (link, rename),
// or creates a device (mknod) or a process.
constexpr std::array kAllowed = {
    SCMP_SYS(brk),        SCMP_SYS(clock_gettime), SCMP_SYS(close),        SCMP_SYS(exit),
    SCMP_SYS(exit_group), SCMP_SYS(fchmod),        SCMP_SYS(fchmodat),     SCMP_SYS(fcntl),
    SCMP_SYS(fstat),      SCMP_SYS(futex),         SCMP_SYS(getdents64),   SCMP_SYS(getpid),
    SCMP_SYS(getrandom),  SCMP_SYS(gettid),        SCMP_SYS(gettimeofday), SCMP_SYS(lseek),
    SCMP_SYS(madvise),    SCMP_SYS(mkdirat),       SCMP_SYS(mremap),       SCMP_SYS(munmap),
    SCMP_SYS(newfstatat), SCMP_SYS(openat),        SCMP_SYS(openat2),      SCMP_SYS(pread64),
    SCMP_SYS(read),       SCMP_SYS(readlinkat),    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigreturn), SCMP_SYS(statx),       SCMP_SYS(symlinkat),    SCMP_SYS(time),
    // An image's upper layer removes and replaces what a lower one has.
    SCMP_SYS(unlinkat), SCMP_SYS(write)};

#if defined(__SANITIZE_ADDRESS__)
// What the sanitizers' reports and memory need.
constexpr std::array kSanitizerCalls = {
    SCMP_SYS(getcwd), SCMP_SYS(getrlimit), SCMP_SYS(ioctl),        SCMP_SYS(open),
    SCMP_SYS(pipe),   SCMP_SYS(pipe2),     SCMP_SYS(prctl),        SCMP_SYS(prlimit64),
    SCMP_SYS(readlink), SCMP_SYS(rt_sigaction), SCMP_SYS(sched_yield), SCMP_SYS(sigaltstack),
    SCMP_SYS(uname)};
#endif

struct Release {
  void operator()(void* context) const { seccomp_release(context); }
};

// Libraries read system files on first use, which the filter would forbid.
void UseLibrariesOnce() {
  ::setenv("TZ", "UTC0", 1);  // times in a zip have no zone, and UTC needs no file
  ::tzset();
  (void)Sha256Hex("");
}

absl::Status Write(const char* path, const std::string& text) {
  const Fd file(::open(path, O_WRONLY | O_CLOEXEC));
  if (!file.valid() || ::write(file.get(), text.data(), text.size()) != std::ssize(text)) {
    return HostError(absl::StrCat("can't write ", path));
  }
  return absl::OkStatus();
}

// Gives a non-root user the right to change its root: in a new user namespace.
absl::Status EnterUserNamespace() {
  const std::string uid = absl::StrCat(::geteuid(), " ", ::geteuid(), " 1");
  const std::string gid = absl::StrCat(::getegid(), " ", ::getegid(), " 1");
  if (::unshare(CLONE_NEWUSER) != 0) {
    return HostError("unpacking needs a user namespace, or root, and can't have one here");
  }
  for (const auto& [path, text] : {std::pair("/proc/self/setgroups", std::string("deny")),
                                   std::pair("/proc/self/gid_map", gid),
                                   std::pair("/proc/self/uid_map", uid)}) {
    RETURN_IF_ERROR(Write(path, text));
  }
  return absl::OkStatus();
}

absl::Status EnterFolder(int folder) {
  if (::fchdir(folder) != 0) return HostError("can't enter the folder to unpack into");
  if (::chroot(".") == 0) return absl::OkStatus();
  if (errno != EPERM) return HostError("can't make the folder to unpack into its own root");
  RETURN_IF_ERROR(EnterUserNamespace());
  return ::chroot(".") == 0 ? absl::OkStatus()
                            : HostError("can't make the folder to unpack into its own root");
}

absl::Status DropRights() {
  __user_cap_header_struct header = {_LINUX_CAPABILITY_VERSION_3, 0};
  const std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> none = {};
  if (::syscall(SYS_capset, &header, none.data()) != 0 ||
      ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return HostError("can't give up capabilities");
  }
  return absl::OkStatus();
}

absl::Status LoadFilter() {
  const std::unique_ptr<void, Release> filter(seccomp_init(SCMP_ACT_KILL_PROCESS));
  if (filter == nullptr) return absl::InternalError("libseccomp has no memory for a filter");
  int result = seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
  for (const int call : kAllowed) {
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, call, 0);
  }
  // Unpacking never needs executable memory.
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)}) {
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, call, 1,
                               SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  }
  // Sets the time of an open file only, never by name.
  result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, SCMP_SYS(utimensat), 1,
                             SCMP_A1(SCMP_CMP_EQ, 0));
  // abort() sends a signal to itself.
  result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1,
                             SCMP_A0(SCMP_CMP_EQ, static_cast<uint64_t>(::getpid())));
#if defined(__SANITIZE_ADDRESS__)
  for (const int call : kSanitizerCalls) {
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, call, 0);
  }
#endif
  if (result != 0) {
    return absl::InternalError("libseccomp refuses a rule of the unpacking's filter");
  }
  if (const int error = seccomp_load(filter.get()); error != 0) {
    errno = -error;
    return HostError("the kernel refuses the unpacking's filter of system calls");
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ConfineUnpacking(int folder) {
  UseLibrariesOnce();
  RETURN_IF_ERROR(EnterFolder(folder));
  RETURN_IF_ERROR(DropRights());
  return LoadFilter();
}

}  // namespace myograde::server
