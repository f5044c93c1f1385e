#include "server/sandbox/control_group.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>
#include <thread>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/clock.h"
#include "server/sandbox/kernel_files.h"

namespace myograde::server {
namespace {

constexpr char kOwnGroup[] = "/daemon";

// This process' group in each hierarchy: "0::/path" or "3:cpu,cpuacct:/path".
std::vector<std::pair<std::set<std::string>, std::string>> OwnGroups(const CgroupHost& host) {
  std::vector<std::pair<std::set<std::string>, std::string>> groups;
  std::istringstream lines(ReadKernelFile(host.membership));
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (parts.size() != 3) continue;
    std::set<std::string> names = absl::StrSplit(parts[1], ',', absl::SkipEmpty());
    groups.emplace_back(std::move(names), parts[2]);
  }
  return groups;
}

// A mounted hierarchy, and this process' place in it.
struct CgroupHierarchy {
  int version = 0;
  std::set<std::string> controllers;  // version 1 only
  std::string folder;                 // this process' own group
  std::string top;                    // the hierarchy's mount point
};

// A mount may show only a part of its hierarchy (in a container): its root says which.
std::vector<CgroupHierarchy> CgroupHierarchies(const CgroupHost& host) {
  const auto own = OwnGroups(host);
  std::vector<CgroupHierarchy> found;
  for (const KernelMount& mount : MountsIn(ReadKernelFile(host.mounts))) {
    const bool v2 = mount.type == "cgroup2";
    if (!v2 && mount.type != "cgroup") continue;
    for (const auto& [names, path] : own) {
      const bool mine = v2 ? names.empty()
                           : !names.empty() && std::ranges::includes(mount.options, names);
      if (!mine) continue;
      std::string below = path;
      if (mount.root != "/" && below.starts_with(mount.root)) below.erase(0, mount.root.size());
      if (below == "/") below.clear();
      found.push_back({v2 ? 2 : 1, names, mount.point + below, mount.point});
    }
  }
  return found;
}

// Where groups for a sandbox may be created, best first. Version 1: below this process' own group.
// Version 2, where a group whose children have controllers can't hold processes itself: beside the
// own group, or at the top.
std::vector<std::string> CgroupParents(const CgroupHierarchy& hierarchy) {
  if (hierarchy.version == 1) return {hierarchy.folder};
  std::vector<std::string> parents;
  if (hierarchy.folder.size() > hierarchy.top.size()) {
    parents.push_back(hierarchy.folder.substr(0, hierarchy.folder.rfind('/')));
  }
  if (parents.empty() || parents.back() != hierarchy.top) parents.push_back(hierarchy.top);
  return parents;
}

absl::Status CantDivide(const std::string& path) {
  return absl::FailedPreconditionError(absl::StrCat(
      path, ": can't be written (", std::strerror(errno),
      "), so the sandboxes have no control groups "
      "although some were delegated; see that nothing else runs in this service's group"));
}

bool IsDelegated(const std::string& folder) {
  // Only the first is readable for an ordinary user.
  for (const char* name : {"user.delegate", "trusted.delegate"}) {
    char value = '0';
    if (getxattr(folder.c_str(), name, &value, sizeof(value)) == 1 && value == '1') return true;
  }
  return false;
}

// The words of a file, such as names of controllers.
std::set<std::string> WordsIn(const std::string& path) {
  return absl::StrSplit(ReadKernelFile(path), absl::ByAnyChar(" \n"), absl::SkipEmpty());
}

// The number after `key` in a file of "key number" lines.
int64_t ReadKey(const std::string& path, const char* key) {
  return KernelNumber(ReadKernelFile(path), absl::StrCat(key, " "));
}

constexpr int kCpuPeriodUs = 100000;

// A tenth of what groups have by default: enough for those who wait for a picture while all processors
// grade, and less than a twentieth of two processors.
constexpr char kBackgroundWeight[] = "10";
constexpr char kBackgroundShares[] = "102";

std::string CpuQuota(double cpus) {
  return std::to_string(std::max<int64_t>(1000, static_cast<int64_t>(cpus * kCpuPeriodUs)));
}

}  // namespace

const CgroupHost& ThisCgroupHost() {
  static const CgroupHost host = {
      .make = [](const std::string& folder) { return mkdir(folder.c_str(), 0755) == 0; },
      .remove = [](const std::string& folder) { return rmdir(folder.c_str()) == 0; },
      .delegated = IsDelegated};
  return host;
}

absl::Status DivideDelegatedGroup(const CgroupHost& host) {
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host)) {
    const std::string& folder = hierarchy.folder;
    if (hierarchy.version != 2 || !host.delegated(folder)) continue;
    const std::set<std::string> offered = WordsIn(folder + "/cgroup.controllers");
    // Where version 1 holds them there is nothing to pass on.
    if (!offered.contains("memory") || !offered.contains("pids")) continue;
    const std::string own = folder + kOwnGroup;
    if (!host.make(own) && errno != EEXIST) return CantDivide(own);
    // The threads of this process go with it.
    if (!WriteKernelFile(own + "/cgroup.procs", "0")) return CantDivide(own + "/cgroup.procs");
    for (const char* controller : {"memory", "pids", "cpu"}) {
      if (!offered.contains(controller)) continue;
      const std::string list = folder + "/cgroup.subtree_control";
      if (WriteKernelFile(list, absl::StrCat("+", controller))) continue;
      const absl::Status status = CantDivide(list);
      WriteKernelFile(folder + "/cgroup.procs", "0");
      host.remove(own);
      return status;
    }
  }
  return absl::OkStatus();
}

std::string GroupName(const std::string& what) {
  static const uint64_t random = [] {
    uint64_t number = 0;
    return getrandom(&number, sizeof(number), 0) == sizeof(number) ? number : 0;
  }();
  return absl::StrCat("myograde.", getpid(), "-", absl::Hex(random, absl::kZeroPad16), ".", what);
}

bool IsGroupName(const std::string& name) {
  static const std::regex made("myograde\\.[0-9]+-[0-9a-f]{16}\\..*");
  return std::regex_match(name, made);
}

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
      const std::set<std::string> offered = WordsIn(parent + "/cgroup.subtree_control");
      if (!offered.contains("memory") || !offered.contains("pids")) continue;
      // Joining needs the right to move processes out of the common parent.
      if (access((parent + "/cgroup.procs").c_str(), W_OK) != 0) continue;
      const std::string folder = parent + "/" + name;
      if (!Make(folder)) continue;
      const auto write = [&](const char* file, const std::string& text) {
        return WriteKernelFile(folder + file, text);
      };
      version_ = 2;
      if (write("/memory.max", std::to_string(limits.memory_bytes))) memory_ = folder;
      write("/memory.swap.max", "0");
      if (write("/pids.max", std::to_string(limits.tasks))) pids_ = folder;
      cpu_limited_ = limits.cpus.has_value() &&
                     write("/cpu.max", absl::StrCat(CpuQuota(*limits.cpus), " ", kCpuPeriodUs));
      if (limits.background) write("/cpu.weight", kBackgroundWeight);
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
    const auto write = [&](const char* file, const std::string& text) {
      return WriteKernelFile(folder + file, text);
    };
    version_ = 1;
    const std::string memory = std::to_string(limits.memory_bytes);
    if (has("memory") && write("/memory.limit_in_bytes", memory)) {
      memory_ = folder;
      write("/memory.memsw.limit_in_bytes", memory);
      write("/memory.swappiness", "0");
    }
    if (has("pids") && write("/pids.max", std::to_string(limits.tasks))) pids_ = folder;
    if (has("cpu") && limits.cpus.has_value()) {
      cpu_limited_ = write("/cpu.cfs_period_us", std::to_string(kCpuPeriodUs)) &&
                     write("/cpu.cfs_quota_us", CpuQuota(*limits.cpus));
    }
    if (has("cpu") && limits.background) write("/cpu.shares", kBackgroundShares);
    if (has("cpuacct")) cpu_account_ = folder;
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
  if (memory_.empty() || version_ == 2) return version_ == 2 || bytes <= memory_bytes_;
  // Small changes are not worth the kernel's work.
  const int64_t rounded = bytes & ~int64_t{0xfffff};
  if (rounded == withheld_) return true;
  const bool fits =
      rounded < memory_bytes_ && WriteKernelFile(memory_ + "/memory.limit_in_bytes",
                                                 std::to_string(memory_bytes_ - rounded));
  if (fits) withheld_ = rounded;
  return fits;
}

int64_t ControlGroup::cpu_ns() const {
  if (cpu_account_.empty()) return -1;
  if (version_ == 2) return ReadKey(cpu_account_ + "/cpu.stat", "usage_usec") * 1000;
  return KernelNumber(ReadKernelFile(cpu_account_ + "/cpuacct.usage"), "", -1);
}

int64_t ControlGroup::peak_memory_bytes() const {
  if (memory_.empty()) return 0;
  const char* file = version_ == 2 ? "/memory.peak" : "/memory.max_usage_in_bytes";
  return KernelNumber(ReadKernelFile(memory_ + file), "");
}

int64_t ControlGroup::oom_kills() const {
  if (memory_.empty()) return 0;
  return ReadKey(memory_ + (version_ == 2 ? "/memory.events" : "/memory.oom_control"),
                 "oom_kill");
}

int64_t ControlGroup::refused_tasks() const {
  return pids_.empty() ? 0 : ReadKey(pids_ + "/pids.events", "max");
}

std::vector<pid_t> ControlGroup::Members() const {
  std::set<pid_t> members;
  for (const std::string& folder : folders_) {
    std::istringstream list(ReadKernelFile(folder + "/cgroup.procs"));
    for (pid_t pid = 0; list >> pid;) {
      if (pid > 0) members.insert(pid);
    }
  }
  return {members.begin(), members.end()};
}

bool ControlGroup::KillAll(absl::Duration timeout) {
  const Deadline deadline(timeout);
  // Version 2 can kill all at once, which no fork can race.
  if (version_ == 2) WriteKernelFile(folders_.front() + "/cgroup.kill", "1");
  while (true) {
    const std::vector<pid_t> members = Members();
    if (members.empty()) return true;
    for (pid_t pid : members) kill(pid, SIGKILL);
    if (deadline.over()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

void ControlGroup::RemoveStale(const CgroupHost& host) {
  std::error_code error;
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host)) {
    for (const std::string& parent : CgroupParents(hierarchy)) {
      std::filesystem::directory_iterator entry(parent, error);
      for (; entry != std::filesystem::directory_iterator(); entry.increment(error)) {
        if (!IsGroupName(entry->path().filename())) continue;
        ControlGroup stale(host);  // if it can be locked
        stale.Lock(entry->path(), LOCK_EX | LOCK_NB);
      }
    }
  }
}

}  // namespace myograde::server
