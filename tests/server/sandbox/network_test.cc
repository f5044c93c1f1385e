// A sandbox' network: what can be measured from outside, and the doctor's checks of the memory that
// all of them share.
#include "server/sandbox/network.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "server/sandbox/doctor_host.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

TEST(NetworkStatistics, AreFoundByNameAndWord) {
  const std::string sockets =
      "sockets: used 17\nTCP: inuse 1 orphan 0 tw 2 alloc 1 mem 351\nUDP: inuse 7 mem 9\n"
      "UDPLITE: inuse 3\n";
  EXPECT_EQ(SocketStatistic(sockets, "UDP:", "inuse"), 7);
  EXPECT_EQ(SocketStatistic(sockets, "UDP:", "mem"), 9);
  EXPECT_EQ(SocketStatistic(sockets, "TCP:", "inuse"), 1);
  EXPECT_EQ(SocketStatistic(sockets, "TCP6:", "inuse"), 0);
  EXPECT_EQ(SocketStatistic(sockets, "UDP:", "inu"), 0);
  EXPECT_EQ(SocketStatistic("", "UDP:", "inuse"), 0);
  const std::string counters =
      "Tcp: RtoMin ActiveOpens\nTcp: 200 4\nUdp: InDatagrams NoPorts MemErrors\nUdp: 43 0 5\n"
      "UdpLite: InDatagrams MemErrors\nUdpLite: 1 8\n";
  EXPECT_EQ(CounterBelow(counters, "Udp:", "MemErrors"), 5);
  EXPECT_EQ(CounterBelow(counters, "Tcp:", "ActiveOpens"), 4);
  EXPECT_EQ(CounterBelow(counters, "Udp:", "RcvbufErrors"), 0);
  EXPECT_EQ(CounterBelow("Udp: MemErrors\n", "Udp:", "MemErrors"), 0);
}

ino_t OwnNetwork() {
  struct stat facts = {};
  stat("/proc/thread-self/ns/net", &facts);
  return facts.st_ino;
}

class BusNetworkTest : public ::testing::Test {
 protected:
  void SetUp() override {
    absl::StatusOr<BusNetwork> made = BusNetwork::Make();
    if (!made.ok() && geteuid() != 0) GTEST_SKIP() << made.status();
    ASSERT_TRUE(made.ok()) << made.status();
    network_ = *std::move(made);
  }

  // Runs `work` inside the namespace.
  void Inside(const std::function<void()>& work) const {
    std::thread([&] {
      ASSERT_EQ(setns(network_->fd(), CLONE_NEWNET), 0);
      work();
    }).join();
  }

  std::optional<BusNetwork> network_;
};

TEST_F(BusNetworkTest, IsNotTheCallersAndTellsItsSockets) {
  const ino_t outside = OwnNetwork();
  EXPECT_EQ(network_->Sample().sockets, 0);
  const int64_t few = network_->Sample().all_sockets;
  Inside([&] {
    {
      const Fd unix_socket(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
      EXPECT_EQ(network_->Sample().all_sockets, few + 1);
      EXPECT_EQ(network_->Sample().sockets, 0);
    }
    EXPECT_NE(OwnNetwork(), outside);
    std::vector<Fd> sockets;
    for (const auto& [family, type] : {std::pair(AF_INET, SOCK_DGRAM), {AF_INET, SOCK_STREAM},
                                       {AF_INET6, SOCK_DGRAM}, {AF_INET6, SOCK_STREAM}}) {
      const Fd& one = sockets.emplace_back(socket(family, type | SOCK_CLOEXEC, 0));
      if (!one.valid()) continue;  // a host without that family
      sockaddr_in6 six = {};
      six.sin6_family = AF_INET6;
      sockaddr_in four = {};
      four.sin_family = AF_INET;
      const int64_t before = network_->Sample().sockets;
      const int bound = family == AF_INET
                            ? bind(one.get(), reinterpret_cast<sockaddr*>(&four), sizeof(four))
                            : bind(one.get(), reinterpret_cast<sockaddr*>(&six), sizeof(six));
      EXPECT_EQ(bound, 0) << errno;
      if (type == SOCK_STREAM) {
        EXPECT_EQ(listen(one.get(), 1), 0);
      }
      EXPECT_EQ(network_->Sample().sockets, before + 1) << family << " " << type;
    }
  });
  EXPECT_EQ(network_->Sample().sockets, 0);
  EXPECT_FALSE(network_->Sample().pool_full);
  EXPECT_EQ(network_->dropped(), 0);
  EXPECT_EQ(OwnNetwork(), outside);
}

TEST_F(BusNetworkTest, BoundsTheBuffersOfItsStreams) {
  if (!network_->bounded()) GTEST_SKIP() << "/proc/sys can't be written here";
  Inside([] {
    for (const char* name : {"tcp_rmem", "tcp_wmem"}) {
      std::ifstream file(std::string("/proc/sys/net/ipv4/") + name);
      int64_t least = 0, fallback = 0, most = 0;
      file >> least >> fallback >> most;
      EXPECT_EQ(most, kStreamBufferBytes) << name;
    }
  });
}

TEST_F(BusNetworkTest, TellsWhatItsSocketsHold) {
  EXPECT_LT(network_->socket_bytes(), 10000);
  std::vector<Fd> kept;
  Inside([&] {
    sockaddr_in place = {};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* address = reinterpret_cast<sockaddr*>(&place);
    socklen_t size = sizeof(place);
    const std::vector<char> text(50000);
    const Fd& reader = kept.emplace_back(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(bind(reader.get(), address, size), 0);
    ASSERT_EQ(getsockname(reader.get(), address, &size), 0);
    const Fd sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(sendto(sender.get(), text.data(), text.size(), 0, address, size), 50000);
    const Fd& listener = kept.emplace_back(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    place.sin_port = 0;
    ASSERT_EQ(bind(listener.get(), address, size), 0);
    ASSERT_EQ(getsockname(listener.get(), address, &size), 0);
    ASSERT_EQ(listen(listener.get(), 1), 0);
    const Fd& stream = kept.emplace_back(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(connect(stream.get(), address, size), 0);
    ASSERT_GT(send(stream.get(), text.data(), text.size(), MSG_DONTWAIT), 30000);
  });
  EXPECT_GT(network_->socket_bytes(), 80000);
  EXPECT_LT(network_->socket_bytes(), 1000000);
}

TEST(SharedLimits, SocketMemoryOfAllSlotsMustLeaveRoom) {
  SocketMemory memory = {.slots = 4, .sockets = 256, .usual_buffer = 212992,
                         .udp_total = int64_t{1} << 30, .tcp_total = int64_t{1} << 30,
                         .bounded = true};
  EXPECT_EQ(JudgeSocketMemory(memory).state, CheckState::kOk);
  memory.usual_buffer = 2 << 20;  // as LCM's guide recommends
  const Check poor = JudgeSocketMemory(memory);
  EXPECT_EQ(poor.state, CheckState::kDegraded);
  EXPECT_THAT(poor.todo, HasSubstr("udp_mem"));
  memory.usual_buffer = 212992;
  memory.slots = 64;
  EXPECT_EQ(JudgeSocketMemory(memory).state, CheckState::kDegraded);
  memory.slots = 4;
  memory.tcp_total = 64 << 20;
  EXPECT_EQ(JudgeSocketMemory(memory).state, CheckState::kDegraded);
  memory.tcp_total = int64_t{1} << 30;
  memory.bounded = false;
  EXPECT_THAT(JudgeSocketMemory(memory).found, HasSubstr("has no bound"));
}

TEST(SharedLimits, DescriptorsInFlightMustNotReachTheRunnersLimit) {
  FlightLimits limits = {.slots = 2, .open_files = 1024, .tasks = 256, .own = 1048576};
  EXPECT_EQ(JudgeFlight(limits).state, CheckState::kOk);
  limits.own = 1024;
  const Check poor = JudgeFlight(limits);
  EXPECT_EQ(poor.state, CheckState::kDegraded);
  EXPECT_THAT(poor.todo, HasSubstr("130560"));
  limits.own = -1;  // root
  EXPECT_EQ(JudgeFlight(limits).state, CheckState::kOk);
}

}  // namespace
}  // namespace myograde::server
