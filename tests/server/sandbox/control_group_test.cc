// Control groups on plain folders that imitate the kernel's, in both versions: what is written
// where, what is read, what remains.
#include "server/sandbox/control_group.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>


namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::IsEmpty;

constexpr GroupLimits kLimits = {512 << 20, 40, 1.5};

class ControlGroupTest : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / absl::StrCat("control-group-", getpid());
    fs::create_directories(root_);
    host_.membership = root_ / "membership";
    host_.mounts = root_ / "mounts";
    // A folder created in a control group file system has its files at once, and is removed with
    // them.
    host_.make = [this](const std::string& folder) {
      if (!fs::create_directory(folder)) return false;
      for (const std::string& file : files_) std::ofstream(folder + "/" + file);
      return true;
    };
    host_.delegated = [this](const std::string& folder) { return folder == delegated_; };
    host_.remove = [this](const std::string& folder) {
      removed_.push_back(fs::path(folder).filename());
      return fs::remove_all(folder) > 0;
    };
  }
  void TearDown() override { fs::remove_all(root_); }

  // A mount of version 1 and this process' place in it.
  void AddVersion1(const std::string& controllers, const std::string& place) {
    const std::string top = root_ / controllers;
    fs::create_directories(top + place);
    std::ofstream(host_.mounts, std::ios::app)
        << "30 25 0:26 / " << top << " rw,relatime - cgroup cgroup rw," << controllers << '\n';
    std::ofstream(host_.membership, std::ios::app) << "4:" << controllers << ":" << place << '\n';
  }

  void AddVersion2(const std::string& place, const std::string& offered) {
    const fs::path top = root_ / "unified";
    fs::create_directories(top / place.substr(1));
    for (fs::path folder = top / place.substr(1); folder != root_; folder = folder.parent_path()) {
      std::ofstream(folder / "cgroup.procs");
      std::ofstream(folder / "cgroup.subtree_control") << offered << '\n';
    }
    std::ofstream(host_.mounts, std::ios::app)
        << "40 25 0:30 / " << top.string() << " rw - cgroup2 cgroup2 rw,nsdelegate\n";
    std::ofstream(host_.membership, std::ios::app) << "0::" << place << '\n';
  }

  static std::string Read(const fs::path& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }

  fs::path root_;
  CgroupHost host_;
  std::string delegated_;  // by a service manager
  std::vector<std::string> files_;
  std::vector<std::string> removed_;
};

TEST_F(ControlGroupTest, WithoutAnyItDoesNothing) {
  const auto group = ControlGroup::Create("none", kLimits, host_);
  EXPECT_EQ(group->controllers().version, 0);
  EXPECT_FALSE(group->controllers().memory || group->controllers().pids ||
               group->controllers().cpu || group->controllers().cpu_account);
  EXPECT_THAT(group->join_fds(), IsEmpty());
  EXPECT_EQ(group->cpu_ns(), -1);
  EXPECT_EQ(group->peak_memory_bytes(), 0);
  EXPECT_EQ(group->oom_kills(), 0);
  EXPECT_EQ(group->refused_tasks(), 0);
  EXPECT_TRUE(group->KillAll(absl::Milliseconds(10)));
}

TEST_F(ControlGroupTest, Version1LimitsAndMeasures) {
  files_ = {"cgroup.procs", "memory.limit_in_bytes", "memory.memsw.limit_in_bytes", "pids.max",
            "cpu.cfs_period_us", "cpu.cfs_quota_us"};
  AddVersion1("memory", "/grader");
  AddVersion1("pids", "");
  AddVersion1("cpu,cpuacct", "");
  {
    const auto group = ControlGroup::Create("lease", kLimits, host_);
    const GroupControllers& got = group->controllers();
    EXPECT_EQ(got.version, 1);
    EXPECT_TRUE(got.memory && got.pids && got.cpu && got.cpu_account);
    const fs::path memory = root_ / "memory/grader/lease";
    const fs::path pids = root_ / "pids/lease";
    const fs::path cpu = root_ / "cpu,cpuacct/lease";
    EXPECT_EQ(Read(memory / "memory.limit_in_bytes"), "536870912");
    EXPECT_EQ(Read(memory / "memory.memsw.limit_in_bytes"), "536870912");
    EXPECT_EQ(Read(pids / "pids.max"), "40");
    EXPECT_EQ(Read(cpu / "cpu.cfs_period_us"), "100000");
    EXPECT_EQ(Read(cpu / "cpu.cfs_quota_us"), "150000");
    EXPECT_EQ(group->join_fds().size(), 3u);
    std::ofstream(memory / "memory.max_usage_in_bytes") << "12345\n";
    std::ofstream(memory / "memory.oom_control")
        << "oom_kill_disable 0\nunder_oom 0\noom_kill 2\n";
    std::ofstream(pids / "pids.events") << "max 3\n";
    std::ofstream(cpu / "cpuacct.usage") << "987654321\n";
    EXPECT_EQ(group->peak_memory_bytes(), 12345);
    EXPECT_EQ(group->oom_kills(), 2);
    EXPECT_EQ(group->refused_tasks(), 3);
    EXPECT_EQ(group->cpu_ns(), 987654321);
  }
  EXPECT_EQ(removed_.size(), 3u);
  EXPECT_FALSE(fs::exists(root_ / "memory/grader/lease"));
}

TEST_F(ControlGroupTest, Version2LimitsAndMeasures) {
  files_ = {"cgroup.procs", "cgroup.kill", "memory.max", "memory.swap.max", "pids.max", "cpu.max"};
  AddVersion2("/grader/daemon", "cpu memory pids");
  const auto group = ControlGroup::Create("lease", kLimits, host_);
  const GroupControllers& got = group->controllers();
  EXPECT_EQ(got.version, 2);
  EXPECT_TRUE(got.memory && got.pids && got.cpu && got.cpu_account);
  const fs::path folder = root_ / "unified/grader/lease";  // beside the daemon's own group
  EXPECT_EQ(Read(folder / "memory.max"), "536870912");
  EXPECT_EQ(Read(folder / "memory.swap.max"), "0");
  EXPECT_EQ(Read(folder / "pids.max"), "40");
  EXPECT_EQ(Read(folder / "cpu.max"), "150000 100000");
  EXPECT_EQ(group->join_fds().size(), 1u);
  std::ofstream(folder / "memory.peak") << "777\n";
  std::ofstream(folder / "memory.events") << "low 0\nhigh 0\nmax 9\noom 1\noom_kill 1\n";
  std::ofstream(folder / "pids.events") << "max 5\n";
  std::ofstream(folder / "cpu.stat") << "usage_usec 4000\nuser_usec 1\n";
  EXPECT_EQ(group->peak_memory_bytes(), 777);
  EXPECT_EQ(group->oom_kills(), 1);
  EXPECT_EQ(group->refused_tasks(), 5);
  EXPECT_EQ(group->cpu_ns(), 4000000);
  EXPECT_TRUE(group->KillAll(absl::Milliseconds(10)));
  EXPECT_EQ(Read(folder / "cgroup.kill"), "1");
}

TEST_F(ControlGroupTest, Version2WithoutItsControllersLeavesTheWorkToVersion1) {
  files_ = {"cgroup.procs", "pids.max"};
  AddVersion2("/", "");
  AddVersion1("pids", "");
  const auto group = ControlGroup::Create("lease", kLimits, host_);
  EXPECT_EQ(group->controllers().version, 1);
  EXPECT_TRUE(group->controllers().pids);
  EXPECT_FALSE(group->controllers().memory);
  EXPECT_FALSE(fs::exists(root_ / "unified/lease"));
}

TEST_F(ControlGroupTest, ADelegatedGroupIsDividedBetweenTheDaemonAndItsSandboxes) {
  files_ = {"cgroup.procs"};
  AddVersion2("/system/grader.service", "");
  const fs::path group = root_ / "unified/system/grader.service";
  std::ofstream(group / "cgroup.controllers") << "cpuset cpu io memory pids\n";
  // Somebody else's, where nothing may be moved.
  EXPECT_TRUE(DivideDelegatedGroup(host_).ok());
  EXPECT_FALSE(fs::exists(group / "daemon"));
  delegated_ = group;
  EXPECT_TRUE(DivideDelegatedGroup(host_).ok());
  EXPECT_EQ(Read(group / "daemon/cgroup.procs"), "0");
  // A file keeps the latest of the writes, which the kernel adds up.
  EXPECT_THAT(Read(group / "cgroup.subtree_control"), ::testing::StartsWith("+cpu"));
}

TEST_F(ControlGroupTest, ADelegatedGroupWithoutControllersStaysWhole) {
  files_ = {"cgroup.procs"};
  AddVersion2("/grader.service", "");
  delegated_ = root_ / "unified/grader.service";
  std::ofstream(delegated_ + "/cgroup.controllers") << "hugetlb\n";
  EXPECT_TRUE(DivideDelegatedGroup(host_).ok());
  EXPECT_FALSE(fs::exists(delegated_ + "/daemon"));
}

TEST_F(ControlGroupTest, ADelegatedGroupThatCantBeDividedIsLeftAsItWas) {
  files_ = {"cgroup.procs"};
  AddVersion2("/grader.service", "");
  delegated_ = root_ / "unified/grader.service";
  std::ofstream(delegated_ + "/cgroup.controllers") << "memory pids\n";
  // Other processes are still in it.
  fs::remove(delegated_ + "/cgroup.subtree_control");
  fs::create_directory(delegated_ + "/cgroup.subtree_control");
  const absl::Status status = DivideDelegatedGroup(host_);
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("cgroup.subtree_control"));
  EXPECT_EQ(Read(delegated_ + "/cgroup.procs"), "0");
  EXPECT_FALSE(fs::exists(delegated_ + "/daemon"));
}

TEST_F(ControlGroupTest, ALimitThatCantBeWrittenIsNotClaimed) {
  files_ = {"cgroup.procs", "cgroup.kill", "pids.max"};
  AddVersion2("/grader/daemon", "memory pids");
  const auto group = ControlGroup::Create("lease", kLimits, host_);
  EXPECT_EQ(group->controllers().version, 2);
  EXPECT_FALSE(group->controllers().memory);
  EXPECT_FALSE(group->controllers().cpu);
  EXPECT_TRUE(group->controllers().pids);
}

TEST_F(ControlGroupTest, WhatIsHeldElsewhereComesOffTheLimitWhereItIsNotCounted) {
  files_ = {"cgroup.procs", "memory.limit_in_bytes", "memory.memsw.limit_in_bytes"};
  AddVersion1("memory", "/a");
  const auto group = ControlGroup::Create("one", kLimits, host_);
  const fs::path limit = root_ / "memory/a/one/memory.limit_in_bytes";
  EXPECT_TRUE(group->Withhold(1000));
  EXPECT_EQ(Read(limit), std::to_string(512 << 20));
  EXPECT_TRUE(group->Withhold((100 << 20) + 7));
  EXPECT_EQ(Read(limit), std::to_string(412 << 20));
  EXPECT_TRUE(group->Withhold(0));
  EXPECT_EQ(Read(limit), std::to_string(512 << 20));
  EXPECT_FALSE(group->Withhold(512 << 20));
  // The kernel can't free memory.
  fs::remove(limit);
  fs::create_directory(limit);
  EXPECT_FALSE(group->Withhold(200 << 20));
}

TEST_F(ControlGroupTest, WhatIsHeldElsewhereHasTheLimitAloneWithoutAGroup) {
  const auto none = ControlGroup::Create("none", kLimits, host_);
  EXPECT_TRUE(none->Withhold(512 << 20));
  EXPECT_FALSE(none->Withhold((512 << 20) + 1));
}

TEST_F(ControlGroupTest, KillsItsMembers) {
  files_ = {"cgroup.procs"};
  AddVersion1("pids", "");
  const auto group = ControlGroup::Create("lease", kLimits, host_);
  const pid_t child = fork();
  if (child == 0) {
    while (true) pause();
  }
  const fs::path list = root_ / "pids/lease/cgroup.procs";
  std::ofstream(list) << child << '\n';
  // Plain folders don't notice that the process died.
  EXPECT_FALSE(group->KillAll(absl::Milliseconds(20)));
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  std::ofstream(list, std::ios::trunc);
  EXPECT_TRUE(group->KillAll(absl::Milliseconds(20)));
}

TEST_F(ControlGroupTest, ASecondStartRemovesWhatAKilledProcessLeft) {
  files_ = {"cgroup.procs"};
  AddVersion1("memory", "");
  AddVersion1("pids", "/grader");
  const pid_t child = fork();
  if (child == 0) {
    const auto lost = ControlGroup::Create(GroupName("7"), kLimits, host_);
    kill(getpid(), SIGKILL);
  }
  waitpid(child, nullptr, 0);
  const auto mine = ControlGroup::Create(GroupName("0"), kLimits, host_);
  fs::create_directory(root_ / "memory/myograde.of-somebody-else");
  fs::create_directory(root_ / "memory/another");
  const auto left = [&] {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(root_ / "memory")) {
      if (entry.is_directory()) names.push_back(entry.path().filename());
    }
    return names;
  };
  EXPECT_EQ(left().size(), 4u);
  ControlGroup::RemoveStale(host_);
  EXPECT_THAT(left(), ::testing::UnorderedElementsAre(GroupName("0"), "another",
                                                      "myograde.of-somebody-else"));
  EXPECT_EQ(removed_.size(), 2u);  // one per controller
}

TEST_F(ControlGroupTest, ALivingProcessKeepsItsGroupsWhateverItsNamespaces) {
  files_ = {"cgroup.procs"};
  AddVersion1("memory", "");
  // A pid and a random number of another pid namespace: here no process has them.
  const std::string name = "myograde.2147483646-0123456789abcdef.0";
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    const auto group = ControlGroup::Create(name, kLimits, host_);
    (void)!write(ready[1], "x", 1);
    while (true) pause();
  }
  char byte = 0;
  ASSERT_EQ(read(ready[0], &byte, 1), 1);
  std::ofstream(root_ / "memory" / name / "cgroup.procs") << child << '\n';
  ControlGroup::RemoveStale(host_);
  EXPECT_THAT(removed_, IsEmpty());
  EXPECT_EQ(kill(child, 0), 0);
  EXPECT_EQ(waitpid(child, nullptr, WNOHANG), 0) << "it was killed";
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  std::ofstream(root_ / "memory" / name / "cgroup.procs", std::ios::trunc);
  ControlGroup::RemoveStale(host_);
  EXPECT_THAT(removed_, ::testing::ElementsAre(name));
  close(ready[0]);
  close(ready[1]);
}

TEST_F(ControlGroupTest, TakesNoGroupOfEarlierVersionsForStale) {
  AddVersion1("memory", "");
  fs::create_directory(root_ / "memory/myograde.2147483646.5.0");
  ControlGroup::RemoveStale(host_);
  EXPECT_THAT(removed_, IsEmpty());
}

TEST(GroupName, IsToldFromOthers) {
  EXPECT_TRUE(IsGroupName(GroupName("3")));
  EXPECT_TRUE(IsGroupName("myograde.7-0123456789abcdef.sim"));
  for (const char* other : {"", "myograde.", "myograde.12", "myograde.12.", "myograde.12.5.0",
                            "myograde.-0123456789abcdef.0", "myograde.12-0123456789abcdef",
                            "myograde.12-0123456789abcde.0", "myograde.x-0123456789abcdef.0",
                            "myograde.12-0123456789abcdefa.0", "system.slice"}) {
    EXPECT_FALSE(IsGroupName(other)) << other;
  }
}

}  // namespace
}  // namespace myograde::server
