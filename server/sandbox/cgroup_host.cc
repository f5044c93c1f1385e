#include "server/sandbox/cgroup_host.h"

#include <sys/random.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "server/sandbox/kernel_files.h"

namespace myograde::server {

namespace {

constexpr std::string_view kPrefix = "myograde.";
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

absl::Status CantDivide(const std::string& path) {
  return absl::FailedPreconditionError(absl::StrCat(
      path, ": can't be written (", std::strerror(errno),
      "), so the sandboxes have no control groups "
      "although some were delegated; see that nothing else runs in this service's group"));
}

}  // namespace

const CgroupHost& ThisCgroupHost() {
  static const CgroupHost host = [] {
    CgroupHost kernel;
    kernel.make = [](const std::string& folder) { return mkdir(folder.c_str(), 0755) == 0; };
    kernel.delegated = [](const std::string& folder) {
      // Only the first is readable for an ordinary user.
      for (const char* name : {"user.delegate", "trusted.delegate"}) {
        char value = '0';
        if (getxattr(folder.c_str(), name, &value, sizeof(value)) == 1 && value == '1') return true;
      }
      return false;
    };
    kernel.remove = [](const std::string& folder) { return rmdir(folder.c_str()) == 0; };
    return kernel;
  }();
  return host;
}

// A mount may show only a part of its hierarchy (in a container): field 4 of its line says which.
std::vector<CgroupHierarchy> CgroupHierarchies(const CgroupHost& host) {
  const auto own = OwnGroups(host);
  std::vector<CgroupHierarchy> found;
  std::istringstream lines(ReadKernelFile(host.mounts));
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> halves = absl::StrSplit(line, absl::MaxSplits(" - ", 1));
    if (halves.size() != 2) continue;
    const std::vector<std::string> left = absl::StrSplit(halves[0], ' ');
    const std::vector<std::string> right = absl::StrSplit(halves[1], ' ');
    if (left.size() < 5 || right.size() < 3) continue;
    const bool v2 = right[0] == "cgroup2";
    if (!v2 && right[0] != "cgroup") continue;
    const std::set<std::string> options = absl::StrSplit(right[2], ',');
    for (const auto& [names, path] : own) {
      const bool mine = v2 ? names.empty()
                           : !names.empty() && std::includes(options.begin(), options.end(),
                                                             names.begin(), names.end());
      if (!mine) continue;
      std::string below = path;
      if (left[3] != "/" && below.rfind(left[3], 0) == 0) below = below.substr(left[3].size());
      if (below == "/") below.clear();
      found.push_back({v2 ? 2 : 1, names, left[4] + below, left[4]});
    }
  }
  return found;
}

std::vector<std::string> CgroupParents(const CgroupHierarchy& hierarchy) {
  if (hierarchy.version == 1) return {hierarchy.folder};
  std::vector<std::string> parents;
  if (hierarchy.folder.size() > hierarchy.top.size()) {
    parents.push_back(hierarchy.folder.substr(0, hierarchy.folder.rfind('/')));
  }
  if (parents.empty() || parents.back() != hierarchy.top) parents.push_back(hierarchy.top);
  return parents;
}

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

std::string GroupName(const std::string& what) {
  static const uint64_t random = [] {
    uint64_t number = 0;
    return getrandom(&number, sizeof(number), 0) == sizeof(number) ? number : 0;
  }();
  return absl::StrCat(absl::string_view(kPrefix.data(), kPrefix.size()), getpid(), "-",
                      absl::Hex(random, absl::kZeroPad16), ".", what);
}

bool IsGroupName(const std::string& name) {
  constexpr char kDigits[] = "0123456789";
  if (!name.starts_with(kPrefix)) return false;
  const size_t dash = name.find_first_not_of(kDigits, kPrefix.size());
  return dash != std::string::npos && dash > kPrefix.size() && name[dash] == '-' &&
         name.find_first_not_of("0123456789abcdef", dash + 1) == dash + 17 &&
         name[dash + 17] == '.';
}

}  // namespace myograde::server
