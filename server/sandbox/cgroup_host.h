// Where this host has control groups and in which of them a process may make
// its own. Version 2 of the kernel's interface, version 1, or both at once.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

namespace myograde::server {

// How the kernel is asked. The defaults ask it; tests put plain folders there.
struct CgroupHost {
  std::string membership = "/proc/self/cgroup";
  std::string mounts = "/proc/self/mountinfo";
  // Both: true if done. On false errno says why.
  std::function<bool(const std::string& folder)> make;    // mkdir
  std::function<bool(const std::string& folder)> remove;  // rmdir
};

const CgroupHost& ThisCgroupHost();

// A mounted hierarchy with the place of this process in it.
struct CgroupHierarchy {
  int version = 0;
  std::set<std::string> controllers;  // of version 1
  std::string folder;                 // of this process' own group
  std::string top;                    // where the hierarchy is mounted
};
std::vector<CgroupHierarchy> CgroupHierarchies(const CgroupHost& host);

// Where groups for a sandbox may lie, the best first. Version 1: below this
// process' own group. Version 2, where a group with children that have
// controllers can't hold processes itself: beside the own group, or at the top.
std::vector<std::string> CgroupParents(const CgroupHierarchy& hierarchy);

// All of a small file of the kernel's; empty if it can't be read. Without streams, as it is
// called many times in each second of a lease.
std::string ReadKernelFile(const std::string& path);

// A name for the group `what` of this process, from which any other process
// can tell later whether this one is still there.
std::string GroupName(const std::string& what);

// True if the name is one of GroupName() and its process is gone.
bool IsStaleGroup(const std::string& name);

}  // namespace myograde::server
