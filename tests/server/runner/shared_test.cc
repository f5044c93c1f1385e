// Kernel resources that leases of one host share: no policy can exhaust them, leave traces in them,
// or be blamed for what another one took.
#include <netinet/in.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <thread>

#include "server/sandbox/network.h"
#include "tests/server/runner/runner_world.h"

namespace myograde::server {
namespace {

using SharedTest = RunnerTest;

TEST_F(SharedTest, SocketsAreBounded) {
  budgets_["startup_s"] = 60;
  const Outcomes outcomes = Play(ScriptOrder(
      "echo last words >&2; exec /usr/bin/python3 -c '\n"
      "import os, socket, time\n"
      "os.fork()\n"
      "kept = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for i in range(200)]\n"
      "[one.bind((\"127.0.0.1\", 0)) for one in kept]\n"
      "time.sleep(1000)'"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_TRUE(outcomes.end->ok) << outcomes.end->detail;
  const FaultEvidence& fault = outcomes.episodes[0].fault;
  EXPECT_EQ(fault.outcome, Outcome::kMemoryLimit) << fault.detail;
  EXPECT_EQ(fault.limit, "sockets");
  EXPECT_EQ(fault.limit_value, 256);
  EXPECT_GT(fault.value, 256);
  EXPECT_THAT(fault.stderr_tail, HasSubstr("last words"));
}

// Sends a descriptor to a socket that nobody reads until the kernel allows this user no more in
// flight. Keeps all ends in `ends`.
int64_t FillTheFlight(std::vector<Fd>& ends) {
  int64_t sent = 0;
  for (int rounds = 0; rounds < 10000; ++rounds) {
    int pair[2];
    if (socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, pair) != 0) break;
    ends.emplace_back(pair[0]);
    ends.emplace_back(pair[1]);
    std::array<int, 100> same;
    same.fill(pair[1]);
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(same))> control = {};
    char byte = 0;
    iovec text = {&byte, 1};
    msghdr message = {};
    message.msg_iov = &text;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    cmsghdr* header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof(same));
    std::memcpy(CMSG_DATA(header), same.data(), sizeof(same));
    if (sendmsg(pair[0], &message, MSG_DONTWAIT) < 0) break;
    sent += std::ssize(same);
  }
  return sent;
}

TEST_F(SharedTest, DescriptorsInFlightOfTheUserHoldUpNoLease) {
  rlimit fallback;
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &fallback), 0);
  if (fallback.rlim_max < 4096) GTEST_SKIP() << "the hard limit of open files is too low";
  // For this process and its children, as in a login session.
  const rlimit low = {512, fallback.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  {
    std::vector<Fd> ends;
    EXPECT_GT(FillTheFlight(ends), 512);
    ends.resize(std::min<size_t>(ends.size(), 100));  // leave some for the caller
    const Outcomes outcomes = Play(ScriptOrder("exit 3"));
    ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
    EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
    EXPECT_TRUE(outcomes.end->ok) << outcomes.end->detail;
  }
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &fallback), 0);
}

TEST_F(SharedTest, NobodyLeavesAMarkInTheTimesOfDevices) {
  const Outcomes outcomes = Play(ScriptOrder(
      "cd /dev; for d in null zero full random urandom tty; do\n"
      "  touch $d || echo $d kept; chmod 600 $d || echo $d is; done\n"
      "echo x > null && echo null works; head -c 1 zero > null && echo zero works\n"
      "cat /proc/sys/fs/dentry-state || echo no counts; exit 3"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  const std::string& said = outcomes.end->stdout_tail;
  for (const char* device : {"null", "zero", "full", "random", "urandom", "tty"}) {
    EXPECT_THAT(said, HasSubstr(absl::StrCat(device, " kept\n")));
    EXPECT_THAT(said, HasSubstr(absl::StrCat(device, " is\n")));
  }
  EXPECT_THAT(said, HasSubstr("null works\nzero works\nno counts\n"));
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("Read-only file system"));
}

// Lowers the threshold at which the kernel drops messages to one page, and holds more than that. No
// message is lost, as usage below the first number is always allowed.
class FullPool {
 public:
  FullPool() {
    std::ifstream file(kPath);
    file >> least_ >> mark_ >> most_;
    set_ = !file.fail() && Write(1);
    absl::StatusOr<BusNetwork> network = BusNetwork::Make();
    if (!network.ok()) return;
    std::thread([&] {
      if (setns(network->fd(), CLONE_NEWNET) != 0) return;
      const Fd sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
      const std::vector<char> text(60000);
      for (int i = 0; i < 100; ++i) {
        const Fd& one = sockets_.emplace_back(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
        sockaddr_in place = {};
        place.sin_family = AF_INET;
        place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        auto* address = reinterpret_cast<sockaddr*>(&place);
        socklen_t size = sizeof(place);
        if (bind(one.get(), address, size) != 0 || getsockname(one.get(), address, &size) != 0) {
          return;
        }
        for (int k = 0; k < 3; ++k) {
          (void)sendto(sender.get(), text.data(), text.size(), 0, address, size);
        }
      }
    }).join();
    full_ = set_ && BusNetwork::Make()->Sample().pool_full;
  }
  ~FullPool() {
    if (set_) Write(mark_);
  }
  bool full() const { return full_; }

 private:
  static constexpr char kPath[] = "/proc/sys/net/ipv4/udp_mem";
  bool Write(int64_t mark) const {
    std::ofstream file(kPath);
    file << least_ << " " << mark << " " << most_ << std::endl;
    return !file.fail();
  }

  int64_t least_ = 0;
  int64_t mark_ = 0;
  int64_t most_ = 0;
  bool set_ = false;
  bool full_ = false;
  std::vector<Fd> sockets_;
};

TEST_F(SharedTest, NobodyIsLateWhileTheHostsMemoryForMessagesIsFull) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can set the host's memory for UDP";
  const FullPool pool;
  if (!pool.full()) GTEST_SKIP() << "this host's memory for UDP can't be set";
  const Outcomes late = Play(ScriptOrder("exec sleep 1000"));
  EXPECT_FALSE(late.end->ok);
  EXPECT_THAT(late.end->detail, HasSubstr("net.ipv4.udp_mem"));
  EXPECT_THAT(late.episodes, ::testing::IsEmpty());
  // Outcomes unrelated to messages stay the participant's.
  const Outcomes crash = Play(ScriptOrder("exit 3"));
  ASSERT_EQ(crash.episodes.size(), 1u) << crash.end->detail;
  EXPECT_EQ(crash.episodes[0].fault.outcome, Outcome::kCrash);
}

}  // namespace
}  // namespace myograde::server
