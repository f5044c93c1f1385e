#include "server/sandbox/control_group.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <set>
#include <sstream>
#include <thread>
#include <utility>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "server/sandbox/kernel_files.h"

namespace myograde::server {
namespace {

constexpr int kCpuPeriodUs = 100000;

int64_t ReadNumber(const std::string& path, int64_t otherwise) {
  const std::string text = ReadKernelFile(path);
  int64_t value = otherwise;
  return absl::SimpleAtoi(text, &value) ? value : otherwise;
}

// The number after `key` in a file of "key number" lines.
int64_t ReadKey(const std::string& path, const std::string& key) {
  std::istringstream lines(ReadKernelFile(path));
  std::string name;
  int64_t value = 0;
  while (lines >> name >> value) {
    if (name == key) return value;
  }
  return 0;
}

// A tenth of what groups have by default: enough for those who wait for a picture while all processors
// grade, and less than a twentieth of two processors.
constexpr char kBackgroundWeight[] = "10";
constexpr char kBackgroundShares[] = "102";

std::string CpuQuota(double cpus) {
  return std::to_string(std::max<int64_t>(1000, static_cast<int64_t>(cpus * kCpuPeriodUs)));
}

}  // namespace

std::unique_ptr<ControlGroup> ControlGroup::Create(const std::string& name,
                                                   const GroupLimits& limits,
                                                   const CgroupHost& host) {
  std::unique_ptr<ControlGroup> group(new ControlGroup(host));
  group->memory_bytes_ = limits.memory_bytes;
  if (!group->TryVersion2(name, limits)) group->TryVersion1(name, limits);
  for (const std::string& folder : group->folders_) {
    Fd list(open((folder + "/cgroup.procs").c_str(), O_WRONLY | O_CLOEXEC));
    if (list.valid()) group->join_.push_back(std::move(list));
  }
  return group;
}

// False if it is gone, or `how` includes LOCK_NB and another process has the lock.
bool ControlGroup::Lock(const std::string& folder, int how) {
  Fd lock(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!lock.valid() || flock(lock.get(), how) != 0) return false;
  struct stat locked = {};
  struct stat there = {};
  // It may have been removed since it was opened.
  if (fstat(lock.get(), &locked) != 0 || lstat(folder.c_str(), &there) != 0 ||
      locked.st_ino != there.st_ino) {
    return false;
  }
  folders_.push_back(folder);
  locks_.push_back(std::move(lock));
  return true;
}

bool ControlGroup::Make(const std::string& folder) {
  // Between its creation and the lock, another process may take it for a stale one and remove it.
  for (int tries = 0; tries < 10; ++tries) {
    if (!host_.make(folder)) return false;
    if (Lock(folder, LOCK_EX)) return true;
  }
  return false;
}

bool ControlGroup::TryVersion2(const std::string& name, const GroupLimits& limits) {
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host_)) {
    if (hierarchy.version != 2) continue;
    for (const std::string& parent : CgroupParents(hierarchy)) {
      const std::set<std::string> offered = absl::StrSplit(
          ReadKernelFile(parent + "/cgroup.subtree_control"), absl::ByAnyChar(" \n"), absl::SkipEmpty());
      if (!offered.contains("memory") || !offered.contains("pids")) continue;
      // Joining needs the right to move processes out of the common parent.
      if (access((parent + "/cgroup.procs").c_str(), W_OK) != 0) continue;
      const std::string folder = parent + "/" + name;
      if (!Make(folder)) continue;
      controllers_.version = 2;
      controllers_.memory = WriteKernelFile(folder + "/memory.max", std::to_string(limits.memory_bytes));
      WriteKernelFile(folder + "/memory.swap.max", "0");
      controllers_.pids = WriteKernelFile(folder + "/pids.max", std::to_string(limits.tasks));
      controllers_.cpu =
          limits.cpus.has_value() &&
          WriteKernelFile(folder + "/cpu.max", absl::StrCat(CpuQuota(*limits.cpus), " ", kCpuPeriodUs));
      controllers_.cpu_account = true;
      if (limits.background) WriteKernelFile(folder + "/cpu.weight", kBackgroundWeight);
      memory_ = controllers_.memory ? folder : "";
      pids_ = controllers_.pids ? folder : "";
      cpu_account_ = folder;
      return true;
    }
  }
  return false;
}

void ControlGroup::TryVersion1(const std::string& name, const GroupLimits& limits) {
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host_)) {
    const auto has = [&](const char* controller) {
      return hierarchy.version == 1 && hierarchy.controllers.contains(controller);
    };
    if (!has("memory") && !has("pids") && !has("cpu") && !has("cpuacct")) continue;
    const std::string folder = hierarchy.folder + "/" + name;
    if (!Make(folder)) continue;
    controllers_.version = 1;
    if (has("memory") &&
        WriteKernelFile(folder + "/memory.limit_in_bytes", std::to_string(limits.memory_bytes))) {
      controllers_.memory = true;
      memory_ = folder;
      WriteKernelFile(folder + "/memory.memsw.limit_in_bytes", std::to_string(limits.memory_bytes));
      WriteKernelFile(folder + "/memory.swappiness", "0");
    }
    if (has("pids") && WriteKernelFile(folder + "/pids.max", std::to_string(limits.tasks))) {
      controllers_.pids = true;
      pids_ = folder;
    }
    if (has("cpu") && limits.cpus.has_value()) {
      controllers_.cpu = WriteKernelFile(folder + "/cpu.cfs_period_us", std::to_string(kCpuPeriodUs)) &&
                         WriteKernelFile(folder + "/cpu.cfs_quota_us", CpuQuota(*limits.cpus));
    }
    if (has("cpu") && limits.background) WriteKernelFile(folder + "/cpu.shares", kBackgroundShares);
    if (has("cpuacct")) {
      controllers_.cpu_account = true;
      cpu_account_ = folder;
    }
  }
}

ControlGroup::~ControlGroup() {
  join_.clear();
  KillAll(absl::Seconds(2));
  for (const std::string& folder : folders_) {
    // A group of dead processes can stay busy for a moment.
    for (int tries = 0; !host_.remove(folder) && errno == EBUSY && tries < 200; ++tries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
}

std::vector<int> ControlGroup::join_fds() const {
  std::vector<int> fds;
  for (const Fd& fd : join_) fds.push_back(fd.get());
  return fds;
}

bool ControlGroup::Withhold(int64_t bytes) {
  if (memory_.empty() || controllers_.version == 2) {
    return controllers_.version == 2 || bytes <= memory_bytes_;
  }
  // Small changes are not worth the kernel's work.
  const int64_t rounded = bytes & ~int64_t{0xfffff};
  if (rounded == withheld_) return true;
  const bool fits = rounded < memory_bytes_ && WriteKernelFile(memory_ + "/memory.limit_in_bytes",
                                                     std::to_string(memory_bytes_ - rounded));
  if (fits) withheld_ = rounded;
  return fits;
}

int64_t ControlGroup::cpu_ns() const {
  if (cpu_account_.empty()) return -1;
  if (controllers_.version == 2) return ReadKey(cpu_account_ + "/cpu.stat", "usage_usec") * 1000;
  return ReadNumber(cpu_account_ + "/cpuacct.usage", -1);
}

int64_t ControlGroup::peak_memory_bytes() const {
  if (memory_.empty()) return 0;
  return ReadNumber(memory_ + (controllers_.version == 2 ? "/memory.peak"
                                                         : "/memory.max_usage_in_bytes"), 0);
}

int64_t ControlGroup::oom_kills() const {
  if (memory_.empty()) return 0;
  return ReadKey(memory_ + (controllers_.version == 2 ? "/memory.events" : "/memory.oom_control"),
                 "oom_kill");
}

int64_t ControlGroup::refused_tasks() const {
  return pids_.empty() ? 0 : ReadKey(pids_ + "/pids.events", "max");
}

std::vector<pid_t> ControlGroup::Members() const {
  std::vector<pid_t> members;
  for (const std::string& folder : folders_) {
    std::istringstream list(ReadKernelFile(folder + "/cgroup.procs"));
    for (pid_t pid = 0; list >> pid;) {
      if (pid > 0) members.push_back(pid);
    }
  }
  std::sort(members.begin(), members.end());
  members.erase(std::unique(members.begin(), members.end()), members.end());
  return members;
}

bool ControlGroup::KillAll(absl::Duration timeout) {
  const Deadline deadline(timeout);
  // Version 2 can kill all at once, which no fork can race.
  if (controllers_.version == 2) WriteKernelFile(folders_.front() + "/cgroup.kill", "1");
  while (true) {
    const std::vector<pid_t> members = Members();
    if (members.empty()) return true;
    for (pid_t pid : members) kill(pid, SIGKILL);
    if (deadline.over()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

void ControlGroup::RemoveStale(const CgroupHost& host) {
  std::set<std::string> parents;
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host)) {
    for (std::string& parent : CgroupParents(hierarchy)) parents.insert(std::move(parent));
  }
  std::error_code error;
  for (const std::string& parent : parents) {
    std::filesystem::directory_iterator entry(parent, error);
    for (; entry != std::filesystem::directory_iterator(); entry.increment(error)) {
      if (!IsGroupName(entry->path().filename())) continue;
      ControlGroup stale(host);  // if it can be locked
      stale.Lock(entry->path(), LOCK_EX | LOCK_NB);
    }
  }
}

}  // namespace myograde::server
