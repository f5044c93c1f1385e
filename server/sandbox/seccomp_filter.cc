#include "server/sandbox/seccomp_filter.h"

#include <sched.h>
#include <seccomp.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <string>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

struct Release {
  void operator()(void* context) const { seccomp_release(context); }
};
using Filter = std::unique_ptr<void, Release>;

constexpr uint64_t kNamespaceFlags = CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC |
                                     CLONE_NEWUSER | CLONE_NEWPID | CLONE_NEWNET;
// Bits of a socket's type beside its flags.
constexpr uint64_t kSocketTypeMask = 0xf;
// The kernel looks at the low half of these arguments only.
constexpr uint64_t kLowHalf = 0xffffffff;

absl::Status DenyByName(scmp_filter_ctx filter, const std::vector<std::string>& names, int error) {
  for (const std::string& name : names) {
    const int number = seccomp_syscall_resolve_name(name.c_str());
    if (number == __NR_SCMP_ERROR) {
      return absl::InvalidArgumentError(
          absl::StrCat("policy.json: \"", name, "\" is no system call; see syscalls(2)"));
    }
    const int result =
        seccomp_rule_add(filter, SCMP_ACT_ERRNO(static_cast<uint16_t>(error)), number, 0);
    if (result != 0) {
      return absl::InternalError(
          absl::StrCat("the system call filter refuses ", name, ": ", strerror(-result)));
    }
  }
  return absl::OkStatus();
}

// Sockets of families that are not listed, one rule for each gap between them.
int DenyFamilies(scmp_filter_ctx filter, std::vector<int> allowed) {
  std::sort(allowed.begin(), allowed.end());
  int result = 0;
  const auto deny = [&](auto... conditions) {
    for (const int call : {SCMP_SYS(socket), SCMP_SYS(socketpair)}) {
      result |= seccomp_rule_add(filter, SCMP_ACT_ERRNO(EPERM), call, sizeof...(conditions),
                                 conditions...);
    }
  };
  for (int family = 0; family < AF_MAX; ++family) {
    if (std::find(allowed.begin(), allowed.end(), family) != allowed.end()) continue;
    deny(SCMP_A0(SCMP_CMP_MASKED_EQ, kLowHalf, static_cast<uint64_t>(family)));
  }
  for (const int type : {SOCK_RAW, SOCK_PACKET}) {
    deny(SCMP_A1(SCMP_CMP_MASKED_EQ, kSocketTypeMask, static_cast<uint64_t>(type)));
  }
  return result;
}

}  // namespace

absl::StatusOr<Fd> MakeSeccompFilter(const PolicySandboxConfig& config) {
  Filter filter(seccomp_init(SCMP_ACT_ALLOW));
  if (filter == nullptr) return absl::InternalError("libseccomp has no memory for a filter");
  int result = seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_ERRNO(EPERM));
  for (const auto& [names, error] :
       {std::pair(&config.denied_system_calls, EPERM),
        std::pair(&config.unimplemented_system_calls, ENOSYS)}) {
    if (absl::Status status = DenyByName(filter.get(), *names, error); !status.ok()) return status;
  }
  for (uint64_t bit = 1; bit <= kNamespaceFlags; bit <<= 1) {
    if ((kNamespaceFlags & bit) == 0) continue;
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ERRNO(EPERM), SCMP_SYS(clone), 1,
                               SCMP_A0(SCMP_CMP_MASKED_EQ, bit, bit));
  }
  for (const uint64_t request : {TIOCSTI, TIOCLINUX}) {
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ERRNO(EPERM), SCMP_SYS(ioctl), 1,
                               SCMP_A1(SCMP_CMP_MASKED_EQ, kLowHalf, request));
  }
  result |= DenyFamilies(filter.get(), config.socket_families);
  if (result != 0) return absl::InternalError("libseccomp refuses a rule of the filter");

  Fd program(memfd_create("myograde-seccomp", MFD_CLOEXEC));
  if (!program.valid()) {
    return absl::InternalError(absl::StrCat("no memory file: ", strerror(errno)));
  }
  if (seccomp_export_bpf(filter.get(), program.get()) != 0 ||
      lseek(program.get(), 0, SEEK_SET) != 0) {
    return absl::InternalError("libseccomp can't write the filter");
  }
  return program;
}

}  // namespace myograde::server
