// The bus together with LCM's own library: each receives the other's messages, and never its own.
#include "protocol/bridge/bus.h"

#include <string>

#include <gtest/gtest.h>
#include <lcm/lcm-cpp.hpp>

#include "myograde/action_t.hpp"
#include "protocol/policy/channels.h"
#include "tests/protocol/bridge/bridge_world.h"
#include "tests/protocol/bridge/messages.h"

namespace myograde {
namespace {

constexpr auto kPatience = std::chrono::milliseconds(50);

class BusTest : public ::testing::Test {
 protected:
  void SetUp() override {
    static const absl::Status entered = EnterPrivateBus();
    if (!entered.ok()) GTEST_SKIP() << "not on this host: " << entered.message();
  }
  static Bus Join(const std::string& url = kBusUrl) {
    absl::StatusOr<Bus> bus = Bus::Open(url, kPatience);
    EXPECT_TRUE(bus.ok()) << bus.status();
    return *std::move(bus);
  }
  // The channel of the next message, waiting up to 5 s; "" if none arrives.
  static std::string Next(Bus& bus) {
    for (int i = 0; i < 100; ++i) {
      const std::optional<Datagram> heard = ParseDatagram(bus.Await());
      if (heard) return std::string(heard->channel);
    }
    return "";
  }
};

TEST_F(BusTest, SpeaksAndHearsAsLcmDoes) {
  Bus bus = Join();
  lcm::LCM lcm(kBusUrl);
  ASSERT_TRUE(lcm.good());
  const action_t action = GoodAction(3, 4);
  action_t heard;
  lcm.subscribeFunction<action_t, action_t*>(
      "A", [](const lcm::ReceiveBuffer*, const std::string&, const action_t* message,
              action_t* out) { *out = *message; }, &heard);
  bus.Send("A", Encode(action));
  ASSERT_GT(lcm.handleTimeout(5000), 0);
  EXPECT_EQ(Encode(heard), Encode(action));

  ASSERT_EQ(lcm.publish("B", &action), 0);
  for (int i = 0; i < 100; ++i) {
    const std::optional<Datagram> datagram = ParseDatagram(bus.Await());
    if (!datagram || datagram->channel != "B") continue;
    EXPECT_EQ(Packet(datagram->payload.begin(), datagram->payload.end()), Encode(action));
    return;
  }
  FAIL() << "nothing came";
}

TEST_F(BusTest, HearsOthersAndNotItself) {
  Bus own = Join();
  Bus other = Join();
  own.Send("own", {});
  other.Send("other", {});
  EXPECT_EQ(Next(own), "other");
  EXPECT_EQ(Next(other), "own");
  EXPECT_TRUE(own.Receive().empty());
  EXPECT_TRUE(own.Await().empty()) << "it waits no longer than it was told";
}

TEST_F(BusTest, IsTheOneOfItsUrl) {
  Bus here = Join("udpm://239.255.76.67:7667");
  Bus there = Join("udpm://239.255.76.68:7668?ttl=0");
  Bus also_there = Join("udpm://239.255.76.68:7668?ttl=1");
  also_there.Send("there", {});
  EXPECT_EQ(Next(there), "there");
  EXPECT_TRUE(here.Receive().empty());
}

TEST_F(BusTest, UrlsOfNoBusAreRefusedWithAReason) {
  for (const char* url :
       {"", "udpm://", "tcpq://127.0.0.1:7700", "udpm://239.255.76.67", "udpm://239.255.76.67:0",
        "udpm://239.255.76.67:65536", "udpm://239.255.76.67:7667?ttl=256",
        "udpm://239.255.76.67:7667?ttl=", "udpm://239.255.76.67:7667?ttl=1&more",
        "udpm://239.255.76.67:7667more", "udpm://127.0.0.1:7667", "udpm://239.255.76:7667"}) {
    const absl::Status status = Bus::Open(url, kPatience).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << url;
    EXPECT_NE(status.message().find("udpm://GROUP:PORT?ttl=N"), absl::string_view::npos) << status;
  }
}

}  // namespace
}  // namespace myograde
