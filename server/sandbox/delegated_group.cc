#include "server/sandbox/delegated_group.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include <cerrno>
#include <cstring>
#include <set>
#include <string>

namespace myograde::server {
namespace {

constexpr char kOwnGroup[] = "/daemon";

absl::Status CantDivide(const std::string& path) {
  return absl::FailedPreconditionError(absl::StrCat(
      path, ": can't be written (", std::strerror(errno),
      "), so the sandboxes have no control groups "
      "although some were delegated; see that nothing else runs in this service's group"));
}

}  // namespace

absl::Status DivideDelegatedGroup(const CgroupHost& host) {
  for (const CgroupHierarchy& hierarchy : CgroupHierarchies(host)) {
    const std::string& folder = hierarchy.folder;
    if (hierarchy.version != 2 || !host.delegated(folder)) continue;
    const std::set<std::string> offered = absl::StrSplit(
        ReadKernelFile(folder + "/cgroup.controllers"), absl::ByAnyChar(" \n"), absl::SkipEmpty());
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

}  // namespace myograde::server
