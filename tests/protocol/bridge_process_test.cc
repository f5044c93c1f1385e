// The bridge as its users meet it: a process with a policy as child, a real
// bus, and LCM's own library on the other side.
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <lcm/lcm-cpp.hpp>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "myograde/episode_start_t.hpp"
#include "myograde/observation_t.hpp"
#include "protocol/channels.h"
#include "tests/protocol/bridge_world.h"
#include "tests/protocol/messages.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;

class BridgeProcessTest : public ::testing::Test {
 protected:
  void SetUp() override {
    static const absl::Status entered = EnterPrivateBus();
    if (!entered.ok()) GTEST_SKIP() << "not on this host: " << entered.message();
  }
  // The bridge with a policy that does nothing; the test speaks in its place.
  void Begin() {
    world_.emplace(std::vector<std::string>{"/bin/sleep", "60"});
    bus_.emplace(kBusUrl);
    ASSERT_TRUE(bus_->good());
  }
  // Says hello until the bridge's socket has joined the bus.
  absl::StatusOr<HelloFrame> Greet() {
    for (int i = 0; i < 100; ++i) {
      const hello_t hello = GoodHello();
      bus_->publish(std::string(kHelloChannel), &hello);
      const auto frame = world_->Hear(absl::Milliseconds(100));
      if (frame.ok()) return std::get<HelloFrame>(*frame);
    }
    return absl::DeadlineExceededError("no hello came through");
  }
  std::string FaultText(BridgeFault kind) {
    const auto frame = world_->Hear();
    if (!frame.ok()) return std::string(frame.status().message());
    const auto* fault = std::get_if<FaultFrame>(&*frame);
    if (fault == nullptr) return "not a fault";
    EXPECT_EQ(fault->fault, kind);
    return fault->detail;
  }

  std::optional<BridgeWorld> world_;
  std::optional<lcm::LCM> bus_;
};

// Subscribed as a function: GCC's sanitizer trips over LCM's call of a method.
struct Counter {
  static void OnObservation(const lcm::ReceiveBuffer*, const std::string&,
                            const observation_t* message, Counter* self) {
    ++self->heard;
    self->last = *message;
  }
  int heard = 0;
  observation_t last;
};

TEST_F(BridgeProcessTest, AsksUntilItIsAnswered) {
  Begin();
  ASSERT_TRUE(Greet().ok());
  Counter counter;
  bus_->subscribeFunction(std::string(kObservationChannel), &Counter::OnObservation, &counter);
  observation_t observation;
  observation.episode = 0;
  observation.step = 0;
  observation.size = 365;
  observation.values.assign(365, 1.5);
  world_->Say(Channel::kObservation, Expect::kAction, 0, 0, 3, Encode(observation));
  // 0, 50, 150 and 350 ms after the question it must have come four times.
  for (int i = 0; i < 50 && counter.heard < 4; ++i) bus_->handleTimeout(100);
  EXPECT_EQ(counter.heard, 4);
  EXPECT_EQ(counter.last.values[364], 1.5);
  action_t action;
  action.episode = 0;
  action.step = 0;
  action.size = 3;
  action.values = {0.5, -0.5, 1};
  bus_->publish(std::string(kActionChannel), &action);
  const auto frame = world_->Hear();
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(std::get<ActionFrame>(*frame).values[1], -0.5);
  // Now it is quiet, but for what was sent before the answer came.
  while (bus_->handleTimeout(0) > 0) {
  }
  const int before = counter.heard;
  bus_->handleTimeout(400);
  EXPECT_EQ(counter.heard, before);
  EXPECT_EQ(world_->HangUp(), 0);
}

TEST_F(BridgeProcessTest, SaysWelcomeAgainToALateHello) {
  Begin();
  ASSERT_TRUE(Greet().ok());
  int welcomes = 0;
  bus_->subscribeFunction<int*>(
      std::string(kWelcomeChannel),
      [](const lcm::ReceiveBuffer*, const std::string&, int* count) { ++*count; }, &welcomes);
  world_->Say(Channel::kWelcome, Expect::kNothing, -1, -1, 0, {std::byte{1}});
  while (welcomes < 1 && bus_->handleTimeout(2000) > 0) {
  }
  const hello_t hello = GoodHello();
  bus_->publish(std::string(kHelloChannel), &hello);
  while (welcomes < 2 && bus_->handleTimeout(2000) > 0) {
  }
  EXPECT_EQ(welcomes, 2);
}

TEST_F(BridgeProcessTest, TellsHowThePolicyEnded) {
  world_.emplace(std::vector<std::string>{"/bin/sh", "-c", "exit 7"});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process exited with status 7");
  world_.emplace(std::vector<std::string>{"/bin/sh", "-c", "kill -SEGV $$"});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process was ended by SIGSEGV");
}

TEST_F(BridgeProcessTest, TellsThatACommandCanNotStart) {
  world_.emplace(std::vector<std::string>{"/no/such/program"});
  EXPECT_THAT(FaultText(BridgeFault::kStartFailed), HasSubstr("No such file"));
}

TEST_F(BridgeProcessTest, ReapsWhatThePolicyLeavesAndOnlyMindsTheMainProcess) {
  world_.emplace(std::vector<std::string>{"/bin/sh", "-c", "sleep 0.1 & sleep 0.3; exit 3"});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process exited with status 3");
}

TEST_F(BridgeProcessTest, ThePolicyFindsItsEnvironmentAndNothingElse) {
  const std::string file = ::testing::TempDir() + "/bridge_environment.txt";
  world_.emplace(std::vector<std::string>{
      "/bin/sh", "-c", "{ env; ls /proc/self/fd; readlink /proc/self/fd/0; } > " + file});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process exited with status 0");
  std::ifstream stream(file);
  const std::string text((std::istreambuf_iterator<char>(stream)), {});
  EXPECT_THAT(text, HasSubstr("MYOGRADE_LCM_URL=udpm://239.255.76.67:7667?ttl=0\n"));
  EXPECT_THAT(text, HasSubstr("MYOGRADE_PROTOCOL=1\n"));
  EXPECT_THAT(text, HasSubstr("HOME=/tmp\n"));
  // ls itself has its folder open as 3.
  EXPECT_THAT(text, HasSubstr("0\n1\n2\n3\n/dev/null\n"));
}

TEST_F(BridgeProcessTest, HostileMessagesEndInAFaultAndNotInTheBridge) {
  Begin();
  ASSERT_TRUE(Greet().ok());
  const char forged[] = "forged";
  bus_->publish(std::string(kObservationChannel), forged, sizeof(forged));
  EXPECT_THAT(FaultText(BridgeFault::kProtocol), HasSubstr("only the grader may send"));
  EXPECT_EQ(world_->HangUp(), 0);
}

TEST_F(BridgeProcessTest, FragmentsAreStraysWhateverTheirSize) {
  Begin();
  ASSERT_TRUE(Greet().ok());
  // 80 fragments, in portions that the kernel's buffer can hold.
  const std::vector<char> large(200 << 10);
  for (int i = 0; i < 20; ++i) {
    bus_->publish("LARGE", large.data(), static_cast<unsigned>(large.size()));
    usleep(10000);
  }
  EXPECT_THAT(FaultText(BridgeFault::kStrayLimit), HasSubstr("more than the 50"));
}

}  // namespace
}  // namespace myograde
