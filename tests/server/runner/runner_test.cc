// Whole leases with the real simulator, bridge and sandboxes: what honest and
// broken policies get, and that nothing of a lease is left.
#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/runner/runner_process.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// The slot's uid, of nobody else on the host: processes of it are a lease's.
constexpr int64_t kSlotUid = 70917;

struct Outcomes {
  std::vector<EpisodeFacts> episodes;
  std::optional<LeaseEndRecord> end;
};

// Pids whose command line holds `text`.
std::vector<int> ProcessesWith(const std::string& text) {
  std::vector<int> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const int pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0 || pid == getpid()) continue;
    std::ifstream file(entry.path() / "cmdline");
    const std::string line((std::istreambuf_iterator<char>(file)), {});
    if (line.find(text) != std::string::npos) found.push_back(pid);
  }
  return found;
}

std::vector<std::string> LeftGroups(pid_t runner) {
  std::vector<std::string> found;
  const std::string name = absl::StrCat("myograde.", runner, ".");
  std::error_code error;
  for (auto it = fs::recursive_directory_iterator(
           "/sys/fs/cgroup", fs::directory_options::skip_permission_denied, error);
       it != fs::recursive_directory_iterator(); it.increment(error)) {
    if (it->path().filename().string().rfind(name, 0) == 0) found.push_back(it->path());
  }
  return found;
}

class RunnerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const char* cache = std::getenv("MYOGRADE_CACHE");
    cache_ = cache != nullptr && *cache != '\0' ? cache : MYOGRADE_TEST_CACHE;
    if (!fs::exists(cache_ + "/myosuite-2.8.4")) GTEST_SKIP() << "no models in " << cache_;
    setenv("MYOGRADE_BIN_DIR", MYOGRADE_BIN_DIR, 0);
    std::string folder = (fs::temp_directory_path() / "myograde-runner-XXXXXX").string();
    ASSERT_NE(mkdtemp(folder.data()), nullptr);
    root_ = folder;
    // A folder that the slot's uid can't enter: as a clone in a home folder.
    fs::permissions(root_, fs::perms::owner_all);
    fs::create_directory(root_ + "/work");
    fs::create_directory(root_ + "/policy");
  }
  void TearDown() override {
    if (!root_.empty()) fs::remove_all(root_);
  }

  LeaseOrder Order(const std::string& track, int episodes) {
    absl::StatusOr<TrackConfig> config =
        LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", track, "");
    EXPECT_TRUE(config.ok()) << config.status();
    nlohmann::json effective = config->effective;
    for (const auto& [key, value] : budgets_.items()) effective["budgets"][key] = value;
    config = ParseTrackConfig(effective, "test");
    EXPECT_TRUE(config.ok()) << config.status();
    LeaseOrder order;
    order.lease = "test";
    order.artefact_dir = root_ + "/policy";
    order.track = *config;
    for (int i = 0; i < episodes; ++i) order.episodes.push_back({i, 10u + i, 20u + i});
    order.uid = geteuid() == 0 ? kSlotUid : -1;
    order.work_dir = root_ + "/work";
    order.cache_dir = cache_;
    return order;
  }

  // A policy that is a shell script.
  LeaseOrder ScriptOrder(const std::string& script, int episodes = 1) {
    std::ofstream(root_ + "/policy/run") << "#!/bin/sh\n" << script << "\n";
    fs::permissions(root_ + "/policy/run", fs::perms(0755));
    fs::permissions(root_ + "/policy", fs::perms(0755));
    LeaseOrder order = Order("manipulation", episodes);
    order.command = {"./run"};
    return order;
  }

  LeaseOrder BundledOrder(const std::string& name, const std::string& track, int episodes) {
    fs::copy_file(absl::StrCat(MYOGRADE_BIN_DIR "/../policies/", name, "/", name),
                  root_ + "/policy/run");
    fs::permissions(root_ + "/policy", fs::perms(0755));
    LeaseOrder order = Order(track, episodes);
    order.command = {"./run"};
    return order;
  }

  Outcomes Play(const LeaseOrder& order, absl::Duration limit = absl::Seconds(100)) {
    Outcomes outcomes;
    absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
    if (!runner.ok()) {
      ADD_FAILURE() << runner.status();
      return outcomes;
    }
    const absl::Time deadline = absl::Now() + limit;
    while (!(*runner)->finished() && absl::Now() < deadline) {
      pollfd entries[] = {{(*runner)->stdout_fd(), POLLIN, 0}, {(*runner)->stderr_fd(), POLLIN, 0}};
      poll(entries, 2, 100);
      absl::StatusOr<std::vector<LeaseRecord>> records = (*runner)->Read();
      EXPECT_TRUE(records.ok()) << records.status();
      if (!records.ok()) break;
      for (LeaseRecord& record : *records) {
        if (auto* facts = std::get_if<EpisodeFacts>(&record)) outcomes.episodes.push_back(*facts);
        if (auto* end = std::get_if<LeaseEndRecord>(&record)) outcomes.end = *end;
      }
    }
    EXPECT_TRUE((*runner)->finished()) << "the lease did not end in time";
    EXPECT_TRUE(outcomes.end.has_value()) << (*runner)->stderr_tail();
    ExpectNothingLeft((*runner)->pid());
    return outcomes;
  }

  void ExpectNothingLeft(pid_t runner) {
    EXPECT_THAT(LeftGroups(runner), ::testing::IsEmpty());
    EXPECT_THAT(ProcessesWith(root_), ::testing::IsEmpty());
    if (geteuid() == 0) {
      EXPECT_THAT(ProcessesOfSlot(), ::testing::IsEmpty());
    }
  }

  static std::vector<int> ProcessesOfSlot() {
    std::vector<int> found;
    for (const auto& entry : fs::directory_iterator("/proc")) {
      struct stat info;
      const int pid = std::atoi(entry.path().filename().c_str());
      if (pid <= 0 || stat(entry.path().c_str(), &info) != 0 || info.st_uid != kSlotUid) continue;
      std::ifstream file(entry.path() / "stat");
      std::string text;
      std::getline(file, text);
      // A dead one that the host's process 1 has not collected yet is none.
      if (text.find(") Z ") == std::string::npos) found.push_back(pid);
    }
    return found;
  }

  std::string cache_;
  std::string root_;
  nlohmann::json budgets_ = {{"startup_s", 3}, {"restarts", 1}};
};

TEST_F(RunnerTest, PlaysTheZeroPolicyTheSameTwice) {
  const LeaseOrder order = BundledOrder("zero", "locomotion", 2);
  const Outcomes first = Play(order);
  const Outcomes second = Play(order);
  ASSERT_EQ(first.episodes.size(), 2u) << first.end->detail;
  ASSERT_EQ(second.episodes.size(), 2u) << second.end->detail;
  EXPECT_TRUE(first.end->ok);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_NE(first.episodes[i].end, EpisodeEnd::kFault) << first.episodes[i].fault.detail;
    EXPECT_EQ(first.episodes[i].digest, second.episodes[i].digest);
  }
  EXPECT_NE(first.episodes[0].digest, first.episodes[1].digest);
  EXPECT_GT(first.end->policy_cpu_s, 0);
}

TEST_F(RunnerTest, PlaysTheRandomPolicyOnTheArm) {
  const Outcomes outcomes = Play(BundledOrder("random", "manipulation", 1));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_NE(outcomes.episodes[0].end, EpisodeEnd::kFault) << outcomes.episodes[0].fault.detail;
  EXPECT_GT(outcomes.episodes[0].steps, 0);
}

TEST_F(RunnerTest, PolicyThatNeverShowsUp) {
  const Outcomes outcomes = Play(ScriptOrder("exec sleep 1000"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kInitTimeout);
}

TEST_F(RunnerTest, PolicyThatEndsAtOnceGetsItsLastWordsTold) {
  const Outcomes outcomes = Play(ScriptOrder("echo out; echo no such model >&2; exit 7", 3));
  ASSERT_EQ(outcomes.episodes.size(), 3u) << outcomes.end->detail;
  EXPECT_TRUE(outcomes.end->ok);
  for (const EpisodeFacts& facts : outcomes.episodes) {
    EXPECT_EQ(facts.fault.outcome, Outcome::kCrash);
    EXPECT_THAT(facts.fault.detail, HasSubstr("7"));
    EXPECT_THAT(facts.fault.detail, HasSubstr("no such model"));
  }
  // Started once, and once more: restarts is 1.
  EXPECT_EQ(outcomes.end->stdout_tail, "out\nout\n");
}

TEST_F(RunnerTest, PolicyThatIsNotExecutable) {
  LeaseOrder order = ScriptOrder("exit 0");
  fs::permissions(root_ + "/policy/run", fs::perms(0644));
  const Outcomes outcomes = Play(order);
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  EXPECT_EQ(outcomes.episodes[0].fault.outcome, Outcome::kCrash);
}

TEST_F(RunnerTest, ForkBombMeetsTheLimitOfTasks) {
  budgets_["tasks"] = 32;
  const Outcomes outcomes =
      Play(ScriptOrder("i=0; while [ $i -lt 200 ]; do sleep 1000 & i=$((i+1)); done; wait"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  const Outcome outcome = outcomes.episodes[0].fault.outcome;
  if (geteuid() == 0) {
    EXPECT_EQ(outcome, Outcome::kProcessLimit) << outcomes.episodes[0].fault.detail;
  } else {
    EXPECT_THAT(outcome, ::testing::AnyOf(Outcome::kProcessLimit, Outcome::kCrash,
                                          Outcome::kInitTimeout));
  }
}

TEST_F(RunnerTest, MemoryEaterIsStopped) {
  budgets_["memory_bytes"] = 256 << 20;
  const Outcomes outcomes =
      Play(ScriptOrder("exec /usr/bin/python3 -c 'x=[bytearray(1<<24) for i in range(1000)]'"));
  ASSERT_EQ(outcomes.episodes.size(), 1u) << outcomes.end->detail;
  const Outcome outcome = outcomes.episodes[0].fault.outcome;
  if (geteuid() == 0) {
    EXPECT_EQ(outcome, Outcome::kMemoryLimit) << outcomes.episodes[0].fault.detail;
  } else {
    EXPECT_THAT(outcome, ::testing::AnyOf(Outcome::kMemoryLimit, Outcome::kCrash));
  }
}

TEST_F(RunnerTest, FloodOfOutputIsCutAndNotedAndSpoilsNoRecord) {
  budgets_["output_bytes"] = 65536;
  const Outcomes outcomes = Play(ScriptOrder("head -c 3000000 /dev/urandom; echo END; exit 3"));
  ASSERT_TRUE(outcomes.end.has_value());
  EXPECT_TRUE(outcomes.end->stdout_truncated);
  EXPECT_FALSE(outcomes.end->stderr_truncated);
  EXPECT_THAT(outcomes.end->stdout_tail, HasSubstr("END"));
  EXPECT_LE(outcomes.end->stdout_tail.size(), 4096u);
}

TEST_F(RunnerTest, SeesNothingOfTheHostAndWritesOnlyToItsScratch) {
  const LeaseOrder order = ScriptOrder(absl::StrCat(
      "echo uid $(id -u); ls /; cat /etc/shadow ", root_, "/work/order.json; touch /policy/x /x "
      "/dev/x /etc/x; echo scratch > /tmp/ok && echo wrote; ls /proc | grep -c '^[0-9]'; "
      "unshare -U true; ls -l /proc/self/fd; exit 1"));
  const Outcomes outcomes = Play(order);
  ASSERT_TRUE(outcomes.end.has_value());
  const LeaseEndRecord& end = *outcomes.end;
  EXPECT_THAT(end.stdout_tail, HasSubstr("uid 1000"));
  EXPECT_THAT(end.stdout_tail, HasSubstr("wrote"));
  EXPECT_THAT(end.stdout_tail, ::testing::Not(HasSubstr("policy_seed")));
  EXPECT_THAT(end.stdout_tail, ::testing::Not(HasSubstr("socket:")));
  EXPECT_THAT(end.stderr_tail, HasSubstr("cannot touch '/policy/x': Read-only"));
  EXPECT_THAT(end.stderr_tail, HasSubstr("cannot touch '/x': Read-only"));
  EXPECT_THAT(end.stderr_tail, HasSubstr("unshare failed: Operation not permitted"));
  EXPECT_FALSE(fs::exists(root_ + "/policy/x"));
}

TEST_F(RunnerTest, KillEndsEverythingWithinASecond) {
  const LeaseOrder order = ScriptOrder("trap '' TERM; setsid sleep 1000 & sleep 1000");
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
  ASSERT_TRUE(runner.ok()) << runner.status();
  absl::SleepFor(absl::Seconds(2));
  const absl::Time start = absl::Now();
  (*runner)->Kill();
  EXPECT_LT(absl::Now() - start, absl::Seconds(1));
  ExpectNothingLeft((*runner)->pid());
}

TEST_F(RunnerTest, NothingSurvivesTheRunnersSigkill) {
  const LeaseOrder order = ScriptOrder("setsid sleep 1000 & sleep 1000");
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
  ASSERT_TRUE(runner.ok()) << runner.status();
  absl::SleepFor(absl::Seconds(2));
  const pid_t first = (*runner)->pid();
  kill(first, SIGKILL);
  ASSERT_TRUE((*runner)->Wait(absl::Seconds(1)).ok());
  absl::SleepFor(absl::Milliseconds(500));
  if (geteuid() == 0) {
    EXPECT_THAT(ProcessesOfSlot(), ::testing::IsEmpty());
  }
  // Its control groups go with the next lease.
  const Outcomes next = Play(ScriptOrder("exit 0"));
  EXPECT_THAT(LeftGroups(first), ::testing::IsEmpty());
}

TEST_F(RunnerTest, BrokenOrdersAreToldInOneSentence) {
  LeaseOrder order = ScriptOrder("exit 0");
  order.cache_dir = root_ + "/nowhere";
  Outcomes outcomes = Play(order);
  EXPECT_FALSE(outcomes.end->ok);
  EXPECT_THAT(outcomes.end->detail, HasSubstr("nowhere"));
  order = ScriptOrder("exit 0");
  order.runtimes = {"/proc/self"};
  outcomes = Play(order);
  EXPECT_FALSE(outcomes.end->ok);
  EXPECT_THAT(outcomes.end->detail, HasSubstr("/proc/self"));
  order.work_dir = root_ + "/no-work";
  EXPECT_TRUE(absl::IsNotFound(RunnerProcess::Start(order).status()));
}

}  // namespace
}  // namespace myograde::server
