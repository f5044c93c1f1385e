// The bridge as a process, with a policy as its child, a real bus, and LCM's own library on the
// other side.
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
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
#include "protocol/base/clock.h"
#include "protocol/policy/channels.h"
#include "tests/protocol/bridge/bridge_world.h"
#include "tests/protocol/bridge/messages.h"

namespace myograde {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class BridgeProcessTest : public ::testing::Test {
 protected:
  void SetUp() override {
    static const absl::Status entered = EnterPrivateBus();
    if (!entered.ok()) GTEST_SKIP() << "not on this host: " << entered.message();
  }
  // The bridge with a policy that does nothing; the test speaks for it.
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
      const auto frame = world_->Receive(absl::Milliseconds(100));
      if (frame.ok()) return std::get<HelloFrame>(*frame);
    }
    return absl::DeadlineExceededError("no hello came through");
  }
  std::string FaultText(BridgeFault kind) {
    const auto frame = world_->Receive();
    if (!frame.ok()) return std::string(frame.status().message());
    const auto* fault = std::get_if<FaultFrame>(&*frame);
    if (fault == nullptr) return "not a fault";
    EXPECT_EQ(fault->fault, kind);
    return fault->detail;
  }

  std::optional<BridgeWorld> world_;
  std::optional<lcm::LCM> bus_;
};

// Subscribed as a function: GCC's sanitizer reports LCM's call of a method.
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
  world_->Send(Channel::kObservation, Expect::kAction, 0, 0, 3, Encode(observation));
  // It must have been sent 0, 50, 150 and 350 ms after the question.
  for (int i = 0; i < 50 && counter.heard < 4; ++i) bus_->handleTimeout(100);
  EXPECT_EQ(counter.heard, 4);
  EXPECT_EQ(counter.last.values[364], 1.5);
  action_t action;
  action.episode = 0;
  action.step = 0;
  action.size = 3;
  action.values = {0.5, -0.5, 1};
  bus_->publish(std::string(kActionChannel), &action);
  const auto frame = world_->Receive();
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(std::get<ActionFrame>(*frame).values[1], -0.5);
  // Silence from now on, except for what was sent before the answer arrived.
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
  world_->Send(Channel::kWelcome, Expect::kNothing, -1, -1, 0, {std::byte{1}});
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

TEST_F(BridgeProcessTest, ACommandThatCanNotStartIsToldWithTheFileThatIsMissing) {
  const std::string folder = ::testing::TempDir() + "/bridge_start";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder + "/folder");
  const auto write = [&](const std::string& name, const std::string& content, int mode) {
    std::ofstream(folder + "/" + name, std::ios::binary) << content;
    std::filesystem::permissions(folder + "/" + name, static_cast<std::filesystem::perms>(mode));
    return folder + "/" + name;
  };
  std::filesystem::create_symlink("/no/such/python3", folder + "/link");
  std::string foreign(64, '\0');
  foreign.replace(0, 5, "\177ELF\002");
  foreign[18] = '\xf3';  // RISC-V
  const std::pair<std::string, std::string> cases[] = {
      {"/no/such/program", "\"/no/such/program\" is not there (No such file"},
      {"no-such-program", "\"no-such-program\" is in none of the folders "},
      {folder + "/link", "is a symbolic link to \"/no/such/python3\", which is not in the sandbox"},
      {folder + "/folder", "is a folder (Permission denied)"},
      {write("data", "weights", 0644), "is not executable: set its bit with chmod +x"},
      {write("script", "#!/no/such/bash\n", 0755),
       "is a script for \"/no/such/bash\", which is not there"},
      {write("foreign", foreign, 0755), "is a program for RISC-V (Exec format error)"}};
  for (const auto& [program, text] : cases) {
    world_.emplace(std::vector<std::string>{program});
    EXPECT_THAT(FaultText(BridgeFault::kStartFailed), HasSubstr(text));
  }
}

// For a script without an interpreter line execvp(3) uses the shell, and so does the bridge.
TEST_F(BridgeProcessTest, AScriptWithoutAnInterpreterIsTheShells) {
  const std::string file = ::testing::TempDir() + "/bridge_script";
  std::ofstream(file) << "exit 9\n";
  std::filesystem::permissions(file, std::filesystem::perms::owner_all);
  world_.emplace(std::vector<std::string>{file});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process exited with status 9");
}

TEST_F(BridgeProcessTest, APolicyMayWriteOutWhatItPrintedBeforeItEnds) {
  const std::string file = ::testing::TempDir() + "/bridge_farewell.txt";
  absl::Duration took;
  // The policy's output; it prints "begun" once it has set its trap.
  const auto words = [&](const std::string& trap, const std::vector<std::string>& options) {
    std::filesystem::remove(file);
    const std::string loop = "; echo begun >> " + file + "; while :; do sleep 0.05; done";
    world_.emplace(std::vector<std::string>{"/bin/sh", "-c", "trap " + trap + " TERM" + loop},
                   options);
    for (int i = 0; i < 500 && !std::filesystem::exists(file); ++i) usleep(10000);
    usleep(50000);
    const absl::Duration start = SystemClock().Monotonic();
    EXPECT_EQ(world_->HangUp(), 0);
    took = SystemClock().Monotonic() - start;
    std::ifstream stream(file);
    return std::string((std::istreambuf_iterator<char>(stream)), {});
  };
  const std::string flushes = "'echo ended >> " + file + "; exit 0'";
  EXPECT_EQ(words(flushes, {}), "begun\n");
  EXPECT_EQ(words(flushes, {"--farewell", "60000"}), "begun\nended\n");
  // A policy that ignores SIGTERM gets that long, and no longer.
  EXPECT_EQ(words("''", {"--farewell", "300"}), "begun\n");
  EXPECT_GE(took, absl::Milliseconds(300));
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

TEST_F(BridgeProcessTest, APolicysOwnVariablesWin) {
  const std::string file = ::testing::TempDir() + "/bridge_own_environment.txt";
  setenv("OMP_NUM_THREADS", "1", 1);
  setenv("PYTHONUNBUFFERED", "1", 1);
  world_.emplace(std::vector<std::string>{"/bin/sh", "-c", "env > " + file},
                 std::vector<std::string>{"--env", "OMP_NUM_THREADS=4", "--env", "POLICY_A=x=y z"});
  EXPECT_EQ(FaultText(BridgeFault::kPolicyExit), "the policy's process exited with status 0");
  std::ifstream stream(file);
  const std::string text((std::istreambuf_iterator<char>(stream)), {});
  EXPECT_THAT(text, HasSubstr("OMP_NUM_THREADS=4\n"));
  EXPECT_THAT(text, Not(HasSubstr("OMP_NUM_THREADS=1")));
  EXPECT_THAT(text, HasSubstr("POLICY_A=x=y z\n"));
  EXPECT_THAT(text, HasSubstr("PYTHONUNBUFFERED=1\n"));
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
  // 80 fragments, in batches that fit the kernel's buffer.
  const std::vector<char> large(200 << 10);
  for (int i = 0; i < 20; ++i) {
    bus_->publish("LARGE", large.data(), static_cast<unsigned>(large.size()));
    usleep(10000);
  }
  EXPECT_THAT(FaultText(BridgeFault::kStrayLimit), HasSubstr("more than the 50"));
}

}  // namespace
}  // namespace myograde
