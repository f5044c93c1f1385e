// Shared by the tests of whole leases: orders for small policies, and checks that nothing of a
// lease is left.
//
// MYOGRADE_TEST_AS=user runs them as an ordinary user, without-groups as root on a host without
// control groups; both start as root.
#pragma once

#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/clock.h"
#include "server/runner/runner_process.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// The slot's uid, used by nothing else on the host: its processes belong to a lease.
inline constexpr int64_t kSlotUid = 70917;

struct Outcomes {
  std::vector<EpisodeFacts> episodes;
  std::optional<LeaseEndRecord> end;
};

// What a file says, of /proc say: "" if its process has ended. (Iterators of the stream's buffer raise
// if it ends while it is read.)
inline std::string TextOf(const fs::path& path) {
  const std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// Pids whose command line holds `text`.
inline std::vector<int> ProcessesWith(const std::string& text) {
  std::vector<int> found;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const int pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0 || pid == getpid()) continue;
    if (TextOf(entry.path() / "cmdline").find(text) != std::string::npos) found.push_back(pid);
  }
  return found;
}

inline std::vector<std::string> LeftGroups(pid_t runner) {
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

// Why these tests can't run as MYOGRADE_TEST_AS requests; "" if they can.
inline std::string BecomeAsAsked() {
  constexpr uid_t kOrdinary = 71999;
  const char* asked = std::getenv("MYOGRADE_TEST_AS");
  const std::string_view as = asked == nullptr ? "" : asked;
  if (as.empty() || (as == "user" && geteuid() == kOrdinary)) return "";
  if (geteuid() != 0) return "only root can become another user or hide control groups";
  if (as == "without-groups") {
    const bool hidden = unshare(CLONE_NEWNS) == 0 &&
                        mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
                        umount2("/sys/fs/cgroup", MNT_DETACH) == 0;
    return hidden ? "" : "control groups can't be hidden here";
  }
  const bool became = setgroups(0, nullptr) == 0 &&
                      setresgid(kOrdinary, kOrdinary, kOrdinary) == 0 &&
                      setresuid(kOrdinary, kOrdinary, kOrdinary) == 0;
  if (!became) return "can't become an ordinary user";
  for (const char* path : {MYOGRADE_BIN_DIR "/myograde-runner", MYOGRADE_SOURCE_DIR "/configs"}) {
    if (access(path, R_OK) != 0) return absl::StrCat("an ordinary user can't read ", path);
  }
  return "";
}

class RunnerTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    static const std::string why = BecomeAsAsked();
    unfit_ = why;
  }

  void SetUp() override {
    if (!unfit_.empty()) GTEST_SKIP() << unfit_;
    const char* cache = std::getenv("MYOGRADE_CACHE");
    cache_ = cache != nullptr && *cache != '\0' ? cache : MYOGRADE_TEST_CACHE;
    if (!fs::exists(cache_ + "/myosuite-2.8.4")) GTEST_SKIP() << "no models in " << cache_;
    setenv("MYOGRADE_BIN_DIR", MYOGRADE_BIN_DIR, 0);
    std::string folder = (fs::temp_directory_path() / "myograde-runner-XXXXXX").string();
    ASSERT_NE(mkdtemp(folder.data()), nullptr);
    root_ = folder;
    // A folder that the slot's uid can't enter, like a clone in a home folder.
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

  // The limit is far above what any test's lease takes, as start-up has more time on a busy host.
  Outcomes Play(const LeaseOrder& order, absl::Duration limit = absl::Seconds(400)) {
    Outcomes outcomes;
    absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order);
    if (!runner.ok()) {
      ADD_FAILURE() << runner.status();
      return outcomes;
    }
    const absl::Duration deadline = SystemClock().Monotonic() + limit;
    while (!(*runner)->finished() && SystemClock().Monotonic() < deadline) {
      if (meddle_) meddle_((*runner)->pid());
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
      if (pid <= 0 || stat(entry.path().c_str(), &info) != 0 ||
          (info.st_uid != kSlotUid && info.st_uid != SimUser(kSlotUid))) {
        continue;
      }
      std::ifstream file(entry.path() / "stat");
      std::string text;
      std::getline(file, text);
      // Ignore zombies that the host's process 1 has not reaped yet.
      if (text.find(") Z ") == std::string::npos) found.push_back(pid);
    }
    return found;
  }

  // True if a control group reports what happened to a policy.
  static bool HasGroups() {
    const auto group = ControlGroup::Create(GroupName("probe"), {1 << 30, 64, 1.0});
    return group->controllers().memory && group->controllers().pids;
  }

  inline static std::string unfit_;
  std::string cache_;
  std::string root_;
  // Called repeatedly while a lease runs, with the runner's pid.
  std::function<void(pid_t)> meddle_;
  nlohmann::json budgets_ = {{"startup_s", 3}, {"restarts", 1}};
};

}  // namespace myograde::server
