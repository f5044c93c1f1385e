// What a policy leaves behind: processes that can't be killed for a while, and CPU time of those
// that nobody waited for.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "tests/server/runner/runner_world.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kLong = absl::Seconds(200);

// A control group whose processes stand still, so that not even SIGKILL ends them.
class Freezer {
 public:
  Freezer() : folder_(absl::StrCat("/sys/fs/cgroup/freezer/myograde-test-", getpid())) {
    there_ = mkdir(folder_.c_str(), 0755) == 0;
  }
  ~Freezer() {
    Thaw();
    const Deadline deadline(kLong);
    while (there_ && rmdir(folder_.c_str()) != 0 && !deadline.over()) usleep(10000);
  }
  bool there() const { return there_; }
  void Freeze(pid_t pid) {
    std::ofstream(folder_ + "/cgroup.procs") << pid << std::flush;
    std::ofstream(folder_ + "/freezer.state") << "FROZEN" << std::flush;
    const Deadline deadline(kLong);
    while (State() != "FROZEN" && !deadline.over()) usleep(10000);
    ASSERT_EQ(State(), "FROZEN");
  }
  void Thaw() { std::ofstream(folder_ + "/freezer.state") << "THAWED" << std::flush; }

 private:
  std::string State() const {
    std::string state;
    std::ifstream(folder_ + "/freezer.state") >> state;
    return state;
  }
  const std::string folder_;
  bool there_ = false;
};

pid_t ParentOf(pid_t pid) {
  std::ifstream status(absl::StrCat("/proc/", pid, "/status"));
  pid_t parent = 0;
  for (std::string word; status >> word;) {
    if (word == "PPid:") status >> parent;
  }
  return parent;
}

class LeftoversTest : public RunnerTest {
 protected:
  void SetUp() override {
    RunnerTest::SetUp();
    if (IsSkipped()) return;
    if (geteuid() != 0 || !freezer_.there()) {
      GTEST_SKIP() << "no control group of version 1 here that stops processes";
    }
    fs::copy(MYOGRADE_SOURCE_DIR "/configs", root_ + "/configs", fs::copy_options::recursive);
    const std::string path = root_ + "/configs/sandbox/policy.json";
    nlohmann::json json = nlohmann::json::parse(std::ifstream(path));
    json["kill_s"] = 1;
    std::ofstream(path) << json;
    setenv("MYOGRADE_CONFIG_DIR", (root_ + "/configs").c_str(), 1);
    budgets_["startup_s"] = 150;
  }
  void TearDown() override {
    unsetenv("MYOGRADE_CONFIG_DIR");
    RunnerTest::TearDown();
  }

  void Start(const LeaseOrder& order) {
    auto runner = RunnerProcess::Start(order);
    ASSERT_TRUE(runner.ok()) << runner.status();
    runner_ = *std::move(runner);
  }

  // Listens until `done`, or for long.
  template <typename Done>
  bool ListenUntil(Done done, absl::Duration limit = kLong) {
    const Deadline deadline(limit);
    while (!done() && !deadline.over()) {
      pollfd entries[] = {{runner_->stdout_fd(), POLLIN, 0}, {runner_->stderr_fd(), POLLIN, 0}};
      poll(entries, 2, 50);
      auto records = runner_->Read();
      if (!records.ok()) {
        ADD_FAILURE() << records.status();
        return false;
      }
      for (LeaseRecord& record : *records) {
        if (auto* facts = std::get_if<EpisodeFacts>(&record)) heard_.episodes.push_back(*facts);
        if (auto* end = std::get_if<LeaseEndRecord>(&record)) heard_.end = *end;
      }
    }
    return done();
  }

  // The policy's `sleep 1000`, once there is one that was not there before.
  pid_t AwaitSleeper(pid_t before = 0, absl::Duration limit = kLong) {
    pid_t found = 0;
    ListenUntil([&] {
      for (const pid_t pid : ProcessesOfSlot()) {
        std::ifstream file(absl::StrCat("/proc/", pid, "/cmdline"));
        const std::string line((std::istreambuf_iterator<char>(file)), {});
        if (line == std::string("sleep\0001000\0", 11) && pid != before) found = pid;
      }
      return found != 0;
    }, limit);
    return found;
  }

  // Ends with status 7 when it is told to, beside a child that stays.
  static constexpr char kScript[] =
      "trap 'exit 7' USR1; sleep 1000 & echo last words >&2; while :; do sleep 0.1; done";

  Freezer freezer_;
  std::unique_ptr<RunnerProcess> runner_;
  Outcomes heard_;
};

TEST_F(LeftoversTest, TheFirstCauseStaysTheVerdictAndNothingIsPlayedBesideThem) {
  Start(ScriptOrder(kScript, 2));
  const pid_t first = AwaitSleeper();
  ASSERT_NE(first, 0);
  freezer_.Freeze(first);
  kill(ParentOf(first), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return heard_.episodes.size() == 1; }));
  EXPECT_EQ(heard_.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(heard_.episodes[0].fault.detail, HasSubstr("status 7"));
  // The next run of the policy waits.
  EXPECT_EQ(AwaitSleeper(first, absl::Seconds(3)), 0);
  EXPECT_THAT(ProcessesOfSlot(), ::testing::Contains(first));
  freezer_.Thaw();
  const pid_t second = AwaitSleeper(first);
  ASSERT_NE(second, 0);
  EXPECT_THAT(ProcessesOfSlot(), ::testing::Not(::testing::Contains(first)));
  kill(ParentOf(second), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return runner_->finished(); }));
  ASSERT_TRUE(heard_.end.has_value());
  EXPECT_TRUE(heard_.end->ok) << heard_.end->detail;
  ASSERT_EQ(heard_.episodes.size(), 2u);
  EXPECT_EQ(heard_.episodes[1].fault.outcome, Outcome::kCrash);
  ExpectNothingLeft(runner_->pid());
}

TEST_F(LeftoversTest, TheLeaseEndsWellAndItsSlotStaysTakenUntilTheyAreGone) {
  Start(ScriptOrder(kScript));
  const pid_t left = AwaitSleeper();
  ASSERT_NE(left, 0);
  freezer_.Freeze(left);
  kill(ParentOf(left), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return heard_.end.has_value(); }));
  EXPECT_TRUE(heard_.end->ok) << heard_.end->detail;
  ASSERT_EQ(heard_.episodes.size(), 1u);
  EXPECT_EQ(heard_.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_FALSE(ListenUntil([&] { return runner_->finished(); }, absl::Seconds(3)));
  freezer_.Thaw();
  ASSERT_TRUE(ListenUntil([&] { return runner_->finished(); }));
  ExpectNothingLeft(runner_->pid());
}

TEST_F(LeftoversTest, ARunnerThatIsToldToEndDoesNotWaitForThem) {
  Start(ScriptOrder(kScript));
  const pid_t left = AwaitSleeper();
  ASSERT_NE(left, 0);
  freezer_.Freeze(left);
  const absl::Duration start = SystemClock().Monotonic();
  runner_->Kill();
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(30));
  EXPECT_TRUE(runner_->dead());
  freezer_.Thaw();
  const Deadline deadline(kLong);
  while (!ProcessesOfSlot().empty() && !deadline.over()) usleep(10000);
  EXPECT_THAT(ProcessesOfSlot(), ::testing::IsEmpty());
}

using LostTimeTest = RunnerTest;

// Python's children use a tenth of a second each. `before` is what their parent does about
// SIGCHLD, `after` what it does for each child.
std::string Churn(const std::string& before, const std::string& after) {
  return absl::StrCat("echo last words >&2; exec /usr/bin/python3 -c 'import os, signal, time\n",
                      before,
                      "\nwhile True:\n"
                      "  if os.fork() == 0:\n"
                      "    while time.process_time() < 0.1: pass\n"
                      "    os._exit(0)\n  ",
                      after, "'");
}

TEST_F(LostTimeTest, OfChildrenThatNobodyWaitsForCounts) {
  budgets_["startup_s"] = 150;
  budgets_["lease_cpu_s"] = 3;
  for (const std::string& before :
       {std::string("signal.signal(signal.SIGCHLD, signal.SIG_IGN)"),
        // A grandchild, whose parent ends at once.
        std::string("signal.signal(signal.SIGCHLD, signal.SIG_IGN)\n"
                    "fork = os.fork\n"
                    "def twice():\n"
                    "  if fork(): return 1\n"
                    "  if fork(): os._exit(0)\n"
                    "  return 0\n"
                    "os.fork = twice")}) {
    const Outcomes outcomes = Play(
        ScriptOrder(Churn(before, "try: os.wait()\n  except ChildProcessError: time.sleep(0.05)")),
        kLong);
    ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
    const FaultEvidence& fault = outcomes.episodes[0].fault;
    EXPECT_EQ(fault.outcome, Outcome::kCpuLimit) << fault.detail;
    EXPECT_EQ(fault.limit, "lease_cpu_s");
  }
}

TEST_F(LostTimeTest, OfAFewHelpersCostsNothingElse) {
  budgets_["startup_s"] = 150;
  budgets_["lease_cpu_s"] = 3;
  // Ten helpers that use 0.1 s each, half of them of a parent that does not wait.
  const Outcomes outcomes = Play(
      ScriptOrder("exec /usr/bin/python3 -c 'import os, signal, time\n"
                  "for i in range(10):\n"
                  "  signal.signal(signal.SIGCHLD, (signal.SIG_IGN, signal.SIG_DFL)[i % 2])\n"
                  "  if os.fork() == 0:\n"
                  "    end = time.process_time() + 0.1\n"
                  "    while time.process_time() < end: pass\n"
                  "    os._exit(0)\n"
                  "  try: os.wait()\n"
                  "  except ChildProcessError: pass\n"
                  "os._exit(9)'"),
      kLong);
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.episodes[0].fault.detail, HasSubstr("status 9"));
  EXPECT_LT(outcomes.end->policy_cpu_s, 2.5);
}

}  // namespace
}  // namespace myograde::server
