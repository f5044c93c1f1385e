// What a policy leaves behind: processes that can't be killed for a while, and CPU time of
// processes that nobody waited for.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>

#include "tests/server/runner/runner_world.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kLong = absl::Seconds(200);

// A control group whose processes are frozen, so that not even SIGKILL ends them. A child of this
// process operates it, as root and with access to the groups, whatever this process becomes later.
class Freezer {
 public:
  Freezer() {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) return;
    asks_ = Fd(ends[0]);
    child_ = fork();
    if (child_ == 0) {
      asks_.reset();
      Serve(ends[1]);
      _exit(0);
    }
    close(ends[1]);
    there_ = Hear();
  }
  ~Freezer() {
    asks_.reset();
    if (child_ > 0) waitpid(child_, nullptr, 0);
  }
  bool there() const { return there_; }
  // True once the process is frozen.
  bool Freeze(pid_t pid) { return Ask(pid); }
  bool Thaw() { return Ask(0); }

 private:
  static bool WaitFor(const std::string& folder, const std::string& wanted) {
    const Deadline deadline(kLong);
    for (std::string state; !deadline.over(); usleep(10000)) {
      std::ifstream(folder + "/freezer.state") >> state;
      if (state == wanted) return true;
    }
    return false;
  }
  // The child's loop, until this end is closed.
  static void Serve(int fd) {
    const std::string folder = absl::StrCat("/sys/fs/cgroup/freezer/myograde-test-", getpid());
    signal(SIGPIPE, SIG_IGN);
    char answer = mkdir(folder.c_str(), 0755) == 0;
    pid_t pid = 0;
    while (write(fd, &answer, 1) == 1 && read(fd, &pid, sizeof(pid)) == sizeof(pid)) {
      if (pid != 0) std::ofstream(folder + "/cgroup.procs") << pid << std::flush;
      const std::string state = pid != 0 ? "FROZEN" : "THAWED";
      std::ofstream(folder + "/freezer.state") << state << std::flush;
      answer = WaitFor(folder, state);
    }
    std::ofstream(folder + "/freezer.state") << "THAWED" << std::flush;
    const Deadline deadline(kLong);
    while (rmdir(folder.c_str()) != 0 && errno == EBUSY && !deadline.over()) usleep(10000);
  }
  bool Ask(pid_t pid) {
    return write(asks_.get(), &pid, sizeof(pid)) == sizeof(pid) && Hear();
  }
  bool Hear() {
    char answer = 0;
    return read(asks_.get(), &answer, 1) == 1 && answer == 1;
  }

  Fd asks_;
  pid_t child_ = -1;
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
  static void SetUpTestSuite() {
    freezer_ = std::make_unique<Freezer>();  // before this process changes its user
    RunnerTest::SetUpTestSuite();
  }
  static void TearDownTestSuite() { freezer_ = nullptr; }

  void SetUp() override {
    RunnerTest::SetUp();
    if (IsSkipped()) return;
    if (!freezer_->there()) {
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
    (void)freezer_->Thaw();
    unsetenv("MYOGRADE_CONFIG_DIR");
    RunnerTest::TearDown();
  }

  void Start(const LeaseOrder& order) {
    auto runner = RunnerProcess::Start(order);
    ASSERT_TRUE(runner.ok()) << runner.status();
    runner_ = *std::move(runner);
  }

  // Reads records until `done`, or for a long time.
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

  // Pids of the policy's sleepers, whoever owns them.
  std::vector<int> Sleepers() const {
    std::vector<int> found;
    for (const int pid : ProcessesWith(seconds_)) {
      const std::string line = TextOf(absl::StrCat("/proc/", pid, "/cmdline"));
      if (line == std::string("sleep\0", 6) + seconds_ + '\0') found.push_back(pid);
    }
    return found;
  }

  // A sleeper that was not there before; waits for one, returns 0 if none comes.
  pid_t AwaitSleeper(pid_t before = 0, absl::Duration limit = kLong) {
    pid_t found = 0;
    ListenUntil([&] {
      for (const pid_t pid : Sleepers()) found = pid != before ? pid : found;
      return found != 0;
    }, limit);
    return found;
  }

  // Exits with status 7 when told to, leaving a child behind.
  std::string Script() const {
    return absl::StrCat("trap 'exit 7' USR1; sleep ", seconds_,
                        " & echo last words >&2; while :; do sleep 0.1; done");
  }

  inline static std::unique_ptr<Freezer> freezer_;
  // Unique to this process' policies.
  const std::string seconds_ = absl::StrCat(10'000'000 + getpid());
  std::unique_ptr<RunnerProcess> runner_;
  Outcomes heard_;
};

TEST_F(LeftoversTest, TheFirstCauseStaysTheVerdictAndNothingIsPlayedBesideThem) {
  Start(ScriptOrder(Script(), 2));
  const pid_t first = AwaitSleeper();
  ASSERT_NE(first, 0);
  ASSERT_TRUE(freezer_->Freeze(first));
  kill(ParentOf(first), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return heard_.episodes.size() == 1; }));
  EXPECT_EQ(heard_.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(heard_.episodes[0].fault.detail, HasSubstr("status 7"));
  // The policy's next run waits.
  EXPECT_EQ(AwaitSleeper(first, absl::Seconds(3)), 0);
  EXPECT_THAT(Sleepers(), ::testing::ElementsAre(first));
  ASSERT_TRUE(freezer_->Thaw());
  const pid_t second = AwaitSleeper(first);
  ASSERT_NE(second, 0);
  EXPECT_THAT(Sleepers(), ::testing::ElementsAre(second));
  kill(ParentOf(second), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return runner_->finished(); }));
  ASSERT_TRUE(heard_.end.has_value());
  EXPECT_TRUE(heard_.end->ok) << heard_.end->detail;
  ASSERT_EQ(heard_.episodes.size(), 2u);
  EXPECT_EQ(heard_.episodes[1].fault.outcome, Outcome::kCrash);
  ExpectNothingLeft(runner_->pid());
}

TEST_F(LeftoversTest, TheLeaseEndsWellAndItsSlotStaysTakenUntilTheyAreGone) {
  Start(ScriptOrder(Script()));
  const pid_t left = AwaitSleeper();
  ASSERT_NE(left, 0);
  ASSERT_TRUE(freezer_->Freeze(left));
  kill(ParentOf(left), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return heard_.end.has_value(); }));
  EXPECT_TRUE(heard_.end->ok) << heard_.end->detail;
  ASSERT_EQ(heard_.episodes.size(), 1u);
  EXPECT_EQ(heard_.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_FALSE(ListenUntil([&] { return runner_->finished(); }, absl::Seconds(3)));
  ASSERT_TRUE(freezer_->Thaw());
  ASSERT_TRUE(ListenUntil([&] { return runner_->finished(); }));
  ExpectNothingLeft(runner_->pid());
}

TEST_F(LeftoversTest, ARunnerThatIsToldToEndDoesNotWaitForThem) {
  Start(ScriptOrder(Script()));
  const pid_t left = AwaitSleeper();
  ASSERT_NE(left, 0);
  ASSERT_TRUE(freezer_->Freeze(left));
  const absl::Duration start = SystemClock().Monotonic();
  runner_->Kill();
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(30));
  EXPECT_TRUE(runner_->dead());
  ASSERT_TRUE(freezer_->Thaw());
  const Deadline deadline(kLong);
  while (!Sleepers().empty() && !deadline.over()) usleep(10000);
  EXPECT_THAT(Sleepers(), ::testing::IsEmpty());
}

// The verdict is reported before anything is waited for, so it outlives the runner.
TEST_F(LeftoversTest, TheFirstCauseStaysTheVerdictIfTheRunnerDiesBesideThem) {
  Start(ScriptOrder(Script(), 2));
  const pid_t left = AwaitSleeper();
  ASSERT_NE(left, 0);
  ASSERT_TRUE(freezer_->Freeze(left));
  kill(ParentOf(left), SIGUSR1);
  ASSERT_TRUE(ListenUntil([&] { return heard_.episodes.size() == 1; }));
  kill(runner_->pid(), SIGKILL);
  ASSERT_TRUE(ListenUntil([&] { return runner_->finished(); }));
  EXPECT_FALSE(heard_.end.has_value());
  ASSERT_EQ(heard_.episodes.size(), 1u);
  EXPECT_EQ(heard_.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(heard_.episodes[0].fault.detail, HasSubstr("status 7"));
  EXPECT_THAT(Sleepers(), ::testing::ElementsAre(left));
  ASSERT_TRUE(freezer_->Thaw());
  const Deadline deadline(kLong);
  while (!Sleepers().empty() && !deadline.over()) usleep(10000);
  EXPECT_THAT(Sleepers(), ::testing::IsEmpty()) << "they had had their SIGKILL";
}

using LostTimeTest = RunnerTest;

// Python children that use a tenth of a second each. `before` is the parent's handling of SIGCHLD,
// `after` what it does after each child.
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
        // A grandchild, whose parent exits at once.
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
  // Ten helpers that use 0.1 s each, half of them children of a parent that does not wait.
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
