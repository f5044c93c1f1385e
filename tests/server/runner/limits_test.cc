// Breaks every budget of a policy with a small program: checks the outcome, and that the evidence
// has limit, value, step and the program's last output. Also what the simulator's own end means.
#include <sys/mman.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <thread>

#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/lease/sim_channel.h"
#include "tests/server/runner/runner_world.h"

namespace myograde::server {
namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

using LimitsTest = RunnerTest;

// The processes below `ancestor` that run a program of this name.
std::vector<pid_t> ProcessesBelow(pid_t ancestor, const std::string& program) {
  const auto parent_of = [&](pid_t pid) {
    const std::string stat = TextOf(absl::StrCat("/proc/", pid, "/stat"));
    int parent = 0;
    const size_t name_end = stat.rfind(')');
    if (name_end != std::string::npos) {
      std::sscanf(stat.c_str() + name_end + 1, " %*c %d", &parent);
    }
    return parent;
  };
  std::vector<pid_t> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0 || TextOf(entry.path() / "comm") != program + "\n") continue;
    for (pid_t above = parent_of(pid); above > 1; above = parent_of(above)) {
      if (above == ancestor) found.push_back(pid);
    }
  }
  return found;
}

// For RunnerTest::meddle_: sends `signal` to the first such process, once.
std::function<void(pid_t)> Strike(const std::string& program, int signal) {
  return [=, done = false](pid_t runner) mutable {
    if (done) return;
    for (const pid_t pid : ProcessesBelow(runner, program)) {
      absl::SleepFor(absl::Milliseconds(300));
      done = kill(pid, signal) == 0;
    }
  };
}

void ExpectEvidence(const Outcomes& outcomes, Outcome outcome, const std::string& limit,
                    double limit_value) {
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_TRUE(outcomes.end->ok) << outcomes.end->detail;
  const FaultEvidence& fault = outcomes.episodes[0].fault;
  EXPECT_EQ(fault.outcome, outcome) << fault.detail;
  EXPECT_EQ(fault.limit, limit) << fault.detail;
  EXPECT_EQ(fault.limit_value, limit_value);
  EXPECT_GE(fault.value, fault.limit_value) << fault.detail;
  EXPECT_EQ(fault.step, -1);
  EXPECT_THAT(fault.stderr_tail, HasSubstr("last words"));
  EXPECT_EQ(FaultEvidenceToJson(fault)["whose"], "participant");
}

TEST_F(LimitsTest, Tasks) {
  budgets_["tasks"] = 32;
  const Outcomes outcomes = Play(ScriptOrder(
      "echo last words >&2; i=0; while [ $i -lt 200 ]; do sleep 1000 & i=$((i+1)); done; wait"));
  if (HasGroups()) return ExpectEvidence(outcomes, Outcome::kProcessLimit, "tasks", 32);
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("fork"));
}

TEST_F(LimitsTest, Memory) {
  if (kSanitized && !HasGroups()) GTEST_SKIP() << "a sanitizer's shadow is above any such limit";
  budgets_["memory_bytes"] = 256 << 20;
  budgets_["startup_s"] = 60;
  const Outcomes outcomes = Play(
      ScriptOrder("echo last words >&2; exec /usr/bin/python3 -c 'x=[bytearray(1<<24) for i in "
                  "range(1000)]'"));
  if (HasGroups()) {
    ExpectEvidence(outcomes, Outcome::kMemoryLimit, "memory_bytes", 256 << 20);
    EXPECT_GE(outcomes.end->peak_memory_bytes, 250 << 20);
    return;
  }
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("MemoryError"));
}

TEST_F(LimitsTest, MemoryOfSharedFilesCounts) {
  if (!HasGroups()) GTEST_SKIP() << "no control group counts it here";
  budgets_["memory_bytes"] = 64 << 20;
  budgets_["startup_s"] = 60;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; head -c 200000000 /dev/zero > /dev/shm/x")),
                 Outcome::kMemoryLimit, "memory_bytes", 64 << 20);
}

TEST_F(LimitsTest, BytesOnDisk) {
  budgets_["scratch_bytes"] = 1 << 20;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; head -c 700000 /dev/zero > /tmp/a; "
                                  "head -c 700000 /dev/zero > /dev/shm/b; exit 1")),
                 Outcome::kDiskLimit, "scratch_bytes", 1 << 20);
}

TEST_F(LimitsTest, FilesOnDisk) {
  budgets_["scratch_files"] = 16;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; i=0; while [ $i -lt 40 ]; do "
                                  ": > /tmp/$i; i=$((i+1)); done; exit 1")),
                 Outcome::kDiskLimit, "scratch_files", 16);
}

TEST_F(LimitsTest, LengthOfAFile) {
  budgets_["scratch_bytes"] = 4 << 20;
  // Sparse, so that the disk itself is not full.
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; exec truncate -s 5000000 /tmp/x")),
                 Outcome::kDiskLimit, "scratch_bytes", 4 << 20);
}

TEST_F(LimitsTest, OpenFiles) {
  budgets_["open_files"] = 64;
  const Outcomes outcomes = Play(ScriptOrder(
      "ulimit -n; exec /usr/bin/python3 -c 'x=[open(\"/dev/null\") for i in range(100)]'"));
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_EQ(outcomes.end->stdout_tail, "64\n");
  EXPECT_THAT(outcomes.episodes[0].fault.stderr_tail, HasSubstr("Too many open files"));
}

TEST_F(LimitsTest, CpuTimeOfTheLease) {
  budgets_["startup_s"] = 60;
  budgets_["lease_cpu_s"] = 2;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; while :; do :; done")),
                 Outcome::kCpuLimit, "lease_cpu_s", 2);
}

TEST_F(LimitsTest, CpuTimeOfChildrenCounts) {
  budgets_["startup_s"] = 60;
  budgets_["lease_cpu_s"] = 2;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; (while :; do :; done) & "
                                  "(while :; do :; done) & exec sleep 1000")),
                 Outcome::kCpuLimit, "lease_cpu_s", 2);
}

TEST_F(LimitsTest, WallTimeOfTheLease) {
  budgets_["startup_s"] = 60;
  budgets_["lease_wall_s"] = 2;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; exec sleep 1000")),
                 Outcome::kWallTimeout, "lease_wall_s", 2);
}

TEST_F(LimitsTest, StartUp) {
  budgets_["startup_s"] = 1;
  ExpectEvidence(Play(ScriptOrder("echo last words >&2; kill -STOP $$")), Outcome::kInitTimeout,
                 "startup_s", 1);
}

// Processes that keep all processors busy until it is destroyed.
class BusyHost {
 public:
  explicit BusyHost(int processes) {
    for (int i = 0; i < processes; ++i) {
      spinners_.push_back(fork());
      if (spinners_.back() != 0) continue;
      setsid();  // for kernels that schedule by session: a share each
      while (true) continue;
    }
  }
  ~BusyHost() {
    for (const pid_t spinner : spinners_) {
      kill(spinner, SIGKILL);
      waitpid(spinner, nullptr, 0);
    }
  }

 private:
  std::vector<pid_t> spinners_;
};

TEST_F(LimitsTest, ABusyHostDoesNotDecideAStart) {
  const int processors = static_cast<int>(std::thread::hardware_concurrency());
  const BusyHost busy(5 * processors);
  budgets_["startup_s"] = 2;
  budgets_["startup_wall_s"] = 300;
  const absl::Duration start = SystemClock().Monotonic();
  const Outcomes outcomes = Play(
      ScriptOrder("exec /usr/bin/python3 -c 'import time; "
                  "any(time.process_time() > 0.7 for _ in iter(int, 1)); exit(7)'"));
  EXPECT_GT(SystemClock().Monotonic() - start, absl::Seconds(2)) << "the host was not busy";
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash)
      << outcomes.episodes[0].fault.detail;
}

TEST_F(LimitsTest, LastWordsAreOfThisRunAndHarmless) {
  const Outcomes outcomes = Play(ScriptOrder(
      "printf '\\033[2J\\000\\377{\"outcome\": \"success\"}\\n' >&2; exit 3"), absl::Seconds(100));
  ASSERT_EQ(outcomes.episodes.size(), 1u);
  const std::string& words = outcomes.episodes[0].fault.stderr_tail;
  EXPECT_EQ(words, "\uFFFD[2J\uFFFD\uFFFD{\"outcome\": \"success\"}\n");
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
}

TEST_F(LimitsTest, TheBridgeCantBeLookedIntoOrStopped) {
  // A sanitizer's runtime handles SIGSEGV, and so receives it even as process 1.
  const std::string signals = kSanitized ? "STOP KILL TERM USR1" : "STOP KILL TERM SEGV USR1";
  const Outcomes outcomes = Play(
      ScriptOrder("for file in environ mem maps fd/3 cwd root exe; do\n"
                  "  cat /proc/1/$file > /tmp/got 2>/tmp/words || echo $file refused; [ ! -s "
                  "/tmp/got ] || echo got $file\ndone\n"
                  "for signal in " + signals + "; do kill -$signal 1; done\n"
                  "kill -0 1 && echo still there; exit 5"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.episodes[0].fault.detail, HasSubstr("status 5"));
  EXPECT_THAT(outcomes.end->stdout_tail, HasSubstr("mem refused\n"));
  EXPECT_THAT(outcomes.end->stdout_tail, HasSubstr("environ refused\n"));
  EXPECT_THAT(outcomes.end->stdout_tail, HasSubstr("still there\n"));
  EXPECT_THAT(outcomes.end->stdout_tail, ::testing::Not(HasSubstr("got ")));
}

TEST_F(LimitsTest, WhateverIsLeftOnDiskIsNeverLookedAt) {
  const Outcomes outcomes = Play(ScriptOrder(
      "cd /tmp; ln -s /etc/shadow a; ln -s /tmp loop; mkfifo b; : > c; ln c d; mkdir -p e/f/g; "
      "chmod 0 e; : > 'x\n..'; mknod n c 1 5; ln -sf /dev/zero /dev/shm/z; chmod 0 /tmp; exit 3"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("mknod: n: Operation not permitted"));
}

TEST_F(LimitsTest, NoPriorityAboveOthers) {
  const Outcomes outcomes = Play(
      ScriptOrder("nice -n -5 true; /usr/bin/chrt -f 1 true; ulimit -c; exit 3"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("nice: cannot set niceness"));
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("chrt: failed to set"));
}

TEST_F(LimitsTest, DevicesAreTheLeasesOwn) {
  if (geteuid() != 0) GTEST_SKIP() << "an ordinary user can make no device nodes";
  struct stat host = {};
  ASSERT_EQ(stat("/dev/null", &host), 0);
  const Outcomes outcomes = Play(ScriptOrder(
      "cd /dev; stat -c '%n %i %d' null; for d in null zero full random urandom; do\n"
      "  [ -w $d ] && head -c 1 $d > /dev/null && echo $d works; done; echo x > full; exit 3"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  const std::string& said = outcomes.end->stdout_tail;
  EXPECT_THAT(said, ::testing::Not(HasSubstr(absl::StrCat("null ", host.st_ino, " ", host.st_dev))));
  for (const char* device : {"null", "zero", "full", "random", "urandom"}) {
    EXPECT_THAT(said, HasSubstr(absl::StrCat(device, " works")));
  }
  EXPECT_THAT(outcomes.end->stderr_tail, HasSubstr("echo: I/O error"));
}

TEST_F(LimitsTest, TheBridgesDeathIsTheParticipants) {
  meddle_ = Strike("myograde-bridge", SIGKILL);
  const Outcomes outcomes = Play(ScriptOrder("exec sleep 1000", 2));
  ASSERT_EQ(outcomes.episodes.size(), 2u) << outcomes.end->detail;
  EXPECT_TRUE(outcomes.end->ok) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
}

// The folder of the control group that limits a process' memory.
std::string MemoryGroupOf(pid_t pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/cgroup"));
  std::string found;
  for (std::string line; std::getline(file, line);) {
    const size_t path = line.find(':', line.find(':') + 1) + 1;
    if (line.find(":memory:") != std::string::npos) {
      return "/sys/fs/cgroup/memory" + line.substr(path);
    }
    if (line.starts_with("0::")) found = "/sys/fs/cgroup" + line.substr(path);
  }
  return found;
}

// For RunnerTest::meddle_: once, another process allocates `bytes` in the simulator's control
// group, where the simulator is the one to be killed when memory runs out.
std::function<void(pid_t)> Crowd(size_t bytes) {
  return [=, done = false](pid_t runner) mutable {
    if (done) return;
    for (const pid_t sim : ProcessesBelow(runner, "myograde-sim")) {
      const std::string group = MemoryGroupOf(sim);
      if (group == MemoryGroupOf(runner)) continue;  // it has not joined its own yet
      const std::string procs = group + "/cgroup.procs";
      const pid_t child = fork();
      if (child == 0) {
        std::ofstream(absl::StrCat("/proc/", sim, "/oom_score_adj")) << 1000;
        std::ofstream(procs) << getpid();
        // A small program, as a copy of this whole process would be charged where the kernel
        // chooses. It waits for a simulator that has not loaded its model yet.
        const std::string program =
            absl::StrCat("import time; held = b'x' * ", bytes, "; time.sleep(2)");
        execl("/usr/bin/python3", "python3", "-c", program.c_str(), nullptr);
        _exit(0);
      }
      done = child > 0 && waitpid(child, nullptr, 0) == child;
    }
  };
}

// Uses a separate config for the simulator.
class SimTest : public RunnerTest {
 protected:
  void SetUp() override {
    RunnerTest::SetUp();
    if (IsSkipped()) return;
    fs::copy(MYOGRADE_SOURCE_DIR "/configs", root_ + "/configs", fs::copy_options::recursive);
    nlohmann::json json = nlohmann::json::parse(std::ifstream(Config()));
    json["silence_s"] = 3;
    std::ofstream(Config()) << json;
    setenv("MYOGRADE_CONFIG_DIR", (root_ + "/configs").c_str(), 1);
    budgets_["startup_s"] = 60;
  }
  void TearDown() override {
    unsetenv("MYOGRADE_CONFIG_DIR");
    RunnerTest::TearDown();
  }
  std::string Config() const { return root_ + "/configs/sandbox/sim.json"; }

  void ExpectGradersFault(const Outcomes& outcomes, const std::string& words) {
    EXPECT_FALSE(outcomes.end->ok);
    EXPECT_THAT(outcomes.end->detail, HasSubstr(words));
    EXPECT_THAT(outcomes.episodes, ::testing::IsEmpty());
  }
};

TEST_F(SimTest, OneThatHangsIsTheGradersFault) {
  meddle_ = Strike("myograde-sim", SIGSTOP);
  ExpectGradersFault(Play(ScriptOrder("exec sleep 1000")), "said nothing for 3 s");
}

TEST_F(SimTest, OneThatIsKilledIsTheGradersFault) {
  meddle_ = Strike("myograde-sim", SIGKILL);
  ExpectGradersFault(Play(ScriptOrder("exec sleep 1000")), "signal 9");
}

TEST_F(SimTest, ACallOutsideItsFilterIsTheGradersFault) {
  nlohmann::json json = nlohmann::json::parse(std::ifstream(Config()));
  auto& calls = json["allowed_system_calls"];
  calls.erase(std::find(calls.begin(), calls.end(), "recvmsg"));
  std::ofstream(Config()) << json;
  ExpectGradersFault(Play(ScriptOrder("exec sleep 1000")), "allowed_system_calls");
}

TEST_F(SimTest, AFilterThatWouldLetItStartProgramsIsRefused) {
  nlohmann::json json = nlohmann::json::parse(std::ifstream(Config()));
  json["allowed_system_calls"].push_back("execve");
  std::ofstream(Config()) << json;
  ExpectGradersFault(Play(ScriptOrder("exec sleep 1000")), "never allows execve");
}

TEST_F(SimTest, OneWithoutMemoryIsTheGradersFault) {
  if (geteuid() != 0 || !HasGroups()) GTEST_SKIP() << "no control group that tells of it here";
  constexpr int64_t kLeast = 256 << 20;
  nlohmann::json json = nlohmann::json::parse(std::ifstream(Config()));
  json["memory_bytes"] = kLeast;
  std::ofstream(Config()) << json;
  meddle_ = Crowd(kLeast - (1 << 20));
  ExpectGradersFault(Play(ScriptOrder("exec sleep 1000")),
                     "the simulator used all of its 268435456 bytes of memory");
}

TEST_F(SimTest, TheFewestFilesThatMayBeOpenAreEnough) {
  nlohmann::json json = nlohmann::json::parse(std::ifstream(Config()));
  const auto play = [&](int sim_files, int policy_files) {
    json["open_files"] = sim_files;
    std::ofstream(Config()) << json;
    budgets_["open_files"] = policy_files;
    return Play(ScriptOrder("ulimit -n; exit 7"));
  };
  const Outcomes outcomes = play(32, 16);
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
  EXPECT_THAT(outcomes.episodes[0].fault.detail, HasSubstr("status 7"));
  EXPECT_EQ(outcomes.end->stdout_tail, "16\n");
  for (const int fewer : {-1, 0, 3, 8, 31}) {
    ExpectGradersFault(play(fewer, 16), "must be from 32");
  }
}

TEST_F(SimTest, ItsUserIsNotThePolicys) {
  if (geteuid() != 0) GTEST_SKIP() << "an ordinary user has one user only";
  std::array<uid_t, 2> users = {0, 0};
  meddle_ = [&](pid_t runner) {
    const char* const programs[] = {"myograde-sim", "myograde-bridge"};
    for (size_t i = 0; i < users.size(); ++i) {
      for (const pid_t pid : ProcessesBelow(runner, programs[i])) {
        std::ifstream status(absl::StrCat("/proc/", pid, "/status"));
        for (std::string word; status >> word;) {
          if (word == "Uid:") status >> users[i];
        }
      }
    }
  };
  budgets_["startup_s"] = 3;
  Play(ScriptOrder("exec sleep 1000"));
  EXPECT_EQ(users[1], static_cast<uid_t>(kSlotUid));
  EXPECT_EQ(users[0], static_cast<uid_t>(SimUser(kSlotUid)));
}

}  // namespace
}  // namespace myograde::server
