// Packets that are filtered are told from packets that are not.
#include "server/base/ip_address.h"

#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <iterator>

namespace myograde::server {
namespace {

// Makes every sendto() of this process fail as the kernel's filters of packets do.
bool FilterPackets() {
  sock_filter program[] = {
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_sendto, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
  };
  const sock_fprog filter = {std::size(program), program};
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0, &filter) == 0;
}

TEST(PacketFilter, SendsToThisHost) {
  EXPECT_FALSE(IsRefused(IpAddress::Parse("127.0.0.1").value()));
}

TEST(PacketFilter, NoticesThatPacketsAreRefused) {
  const pid_t child = fork();
  if (child == 0) {
    _exit(FilterPackets() && IsRefused(IpAddress::Parse("127.0.0.1").value()) ? 0 : 1);
  }
  int status = -1;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST(PacketFilter, TheAddressForOtherHostsIsNoLoopback) {
  const std::optional<IpAddress> own = OwnAddress();
  if (!own.has_value()) GTEST_SKIP() << "this host has no network";
  EXPECT_FALSE(own->IsLoopback());
}

}  // namespace
}  // namespace myograde::server
