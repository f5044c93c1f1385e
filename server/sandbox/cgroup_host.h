// Where this host has control groups, and where a process may create its own. Supports version 2 of
// the kernel's interface, version 1, and both at once.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>

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

// A mounted hierarchy, and this process' place in it.
struct CgroupHierarchy {
  int version = 0;
  std::set<std::string> controllers;  // version 1 only
  std::string folder;                 // this process' own group
  std::string top;                    // the hierarchy's mount point
};
std::vector<CgroupHierarchy> CgroupHierarchies(const CgroupHost& host);

// Where groups for a sandbox may be created, best first. Version 1: below this process' own group.
// Version 2, where a group whose children have controllers can't hold processes itself: beside the
// own group, or at the top.
std::vector<std::string> CgroupParents(const CgroupHierarchy& hierarchy);

// If a service manager has delegated this process' own group of version 2 to it (systemd's
// Delegate=): moves this process into a group `daemon` in it and passes memory, pids and cpu on, as
// far as they are there, so that ControlGroup can make the sandboxes' groups beside it. Version 2
// has no processes in a group whose children have controllers, and systemd only from 254 on makes
// such a group itself. Otherwise does nothing. Call while this process has no
// children, which would stay behind.
// FailedPreconditionError: the group was delegated but can't be divided; this process stays in it.
absl::Status DivideDelegatedGroup(const CgroupHost& host = ThisCgroupHost());

// A name for this process' group `what`, which no other process of the host gives, whatever pid
// namespace it is in.
std::string GroupName(const std::string& what);

// True if GroupName() made the name, in any process.
bool IsGroupName(const std::string& name);

}  // namespace myograde::server
