// Control groups: where this host has them, where a process may create its own, and one for each
// sandbox, which enforces limits, measures use, and kills all its processes. Uses whichever version
// of the kernel's interface holds the controllers here, 1 or 2; without either the sandbox falls
// back to rlimits and to adding up the CPU time of its process tree.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"

namespace myograde::server {

// The operations on the kernel's interface. The defaults are the real ones; tests substitute plain
// folders.
struct CgroupHost {
  std::string membership = "/proc/self/cgroup";
  std::string mounts = "/proc/self/mountinfo";
  // Both return true on success; otherwise errno says why.
  std::function<bool(const std::string& folder)> make;    // mkdir
  std::function<bool(const std::string& folder)> remove;  // rmdir
  // Whether a service manager has left this group to the processes in it (systemd's Delegate=).
  std::function<bool(const std::string& folder)> delegated;
};

const CgroupHost& ThisCgroupHost();

// If a service manager has delegated this process' own group of version 2 to it (systemd's
// Delegate=): moves this process into a group `daemon` in it, as systemd itself does from 254 on,
// and passes memory, pids and cpu on, as far as they are there, so that ControlGroup can make the
// sandboxes' groups beside it. Call while this process has no children, which would stay behind.
// FailedPreconditionError: the group was delegated but can't be divided; this process stays in it.
absl::Status DivideDelegatedGroup(const CgroupHost& host = ThisCgroupHost());

// A name for this process' group `what`, which no other process of the host gives, whatever pid
// namespace it is in.
std::string GroupName(const std::string& what);

// True if GroupName() made the name, in any process.
bool IsGroupName(const std::string& name);

struct GroupLimits {
  int64_t memory_bytes = 0;
  int64_t tasks = 0;  // processes and threads
  // Processors. Unset for the simulator, a single thread that can't start another.
  std::optional<double> cpus;
  bool background = false;  // a small share of processors that others want too
};

// The controllers that a group was created with.
struct GroupControllers {
  int version = 0;  // 0: none
  bool memory = false;
  bool pids = false;
  bool cpu = false;          // the limit on processors
  bool cpu_account = false;  // measured CPU time
};

class ControlGroup {
 public:
  // Creates a group `name` (no slashes) with the limits and with as many controllers as this
  // process may use; controllers() says which. Never fails: a group without any controller does
  // nothing. `host` must outlive the group.
  static std::unique_ptr<ControlGroup> Create(const std::string& name, const GroupLimits& limits,
                                              const CgroupHost& host = ThisCgroupHost());

  // Kills what is left in it and removes it.
  ~ControlGroup();
  ControlGroup(const ControlGroup&) = delete;
  ControlGroup& operator=(const ControlGroup&) = delete;

  GroupControllers controllers() const {
    return {version_, !memory_.empty(), !pids_.empty(), cpu_limited_, !cpu_account_.empty()};
  }

  // Descriptors of the groups' process lists: a child joins by writing "0" to each (before it gives
  // up its uid).
  std::vector<int> join_fds() const;

  // Lowers its memory limit by `bytes`, for memory that the group uses but this version does not
  // count; version 2 counts everything. False: it uses more than is left. May wait for the kernel
  // to free memory.
  bool Withhold(int64_t bytes);

  int64_t cpu_ns() const;           // -1: not measured
  int64_t peak_memory_bytes() const;  // 0: not measured
  int64_t oom_kills() const;        // processes killed when memory ran out
  int64_t refused_tasks() const;    // forks that failed at the task limit

  std::vector<pid_t> Members() const;

  // Kills all its processes and waits until it is empty. False: some are left at `timeout`.
  bool KillAll(absl::Duration timeout);

  // Kills what is left in groups whose creators are gone, and removes them. Call when starting to
  // create groups. A creator keeps a lock on its groups, which the kernel releases when it ends: a
  // pid or start time of another namespace would say nothing here.
  static void RemoveStale(const CgroupHost& host = ThisCgroupHost());

 private:
  explicit ControlGroup(const CgroupHost& host) : host_(host) {}
  bool Make(const std::string& folder);
  bool Lock(const std::string& folder, int how);
  bool TryVersion2(const std::string& name, const GroupLimits& limits);
  void TryVersion1(const std::string& name, const GroupLimits& limits);

  const CgroupHost& host_;
  int version_ = 0;
  bool cpu_limited_ = false;
  std::vector<std::string> folders_;  // all that were created
  std::vector<Fd> locks_;             // on each of them, until it is removed
  int64_t memory_bytes_ = 0;          // the limit
  int64_t withheld_ = 0;              // of the limit
  std::string memory_;                // each controller's folder, "" if none
  std::string pids_;
  std::string cpu_account_;
  std::vector<Fd> join_;
};

}  // namespace myograde::server
