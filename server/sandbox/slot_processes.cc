#include "server/sandbox/slot_processes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include <absl/strings/str_cat.h>

#include "server/base/plain_text.h"
#include "server/sandbox/kernel_files.h"
#include "server/sandbox/process_tree.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// What the kernel appends to the path of a removed folder.
constexpr std::string_view kDeleted = "//deleted";

// A location: a file system by its device, and a path from its root.
using Place = std::pair<std::string, std::string>;

struct StatusFacts {
  std::string name;
  std::string state;
  int64_t user = -1;
  int64_t threads = 0;

  bool dead() const { return state.empty() || state == "Z" || state == "X"; }
};

// `path`: the /proc folder of a process or thread. All fields are empty if it is gone.
StatusFacts ReadStatus(const std::string& path) {
  // The file's owner says nothing: for a process that can't be inspected it is root.
  const std::string text = ReadKernelFile(path + "/status");
  StatusFacts facts;
  // Names are escaped, so no process can forge a line.
  facts.name = KernelValue(text, "Name:");
  facts.state = KernelValue(text, "State:").substr(0, 1);
  facts.user = KernelNumber(text, "Uid:", -1);
  facts.threads = KernelNumber(text, "Threads:");
  return facts;
}

// nullopt if the process is dead. A process whose first thread has ended looks dead, but lives as
// long as another thread does: a thread that can't be killed yet is usually not the first.
std::optional<StatusFacts> Living(const std::string& path) {
  StatusFacts facts = ReadStatus(path);
  if (!facts.dead()) return facts;
  if (facts.threads < 2) return std::nullopt;
  for (const pid_t thread : NumbersIn(path + "/task")) {
    StatusFacts other = ReadStatus(absl::StrCat(path, "/task/", thread));
    if (!other.dead()) return other;
  }
  return std::nullopt;
}

void Append(pid_t pid, const StatusFacts& facts, std::string& words) {
  absl::StrAppend(&words, words.empty() ? "" : ", ", pid, " (", PrintableUtf8(facts.name),
                  ", state ", facts.state, ")");
}

// The mounts that a process or thread sees; empty if it has none any more. Never waits for a file
// system.
std::vector<KernelMount> ReadMounts(const std::string& path) {
  return MountsIn(ReadKernelFile(path + "/mountinfo"));
}

// Returns an error number: ENOENT if it has none any more.
int MountNamespaceOf(const std::string& path, std::string& space) {
  char name[64];
  const std::string link = path + "/ns/mnt";
  const ssize_t size = readlink(link.c_str(), name, sizeof(name));
  if (size < 0) return errno;
  space.assign(name, static_cast<size_t>(size));
  return 0;
}

// For a folder that exists, as it is mounted here.
std::optional<Place> FindPlace(const std::string& folder) {
  std::error_code error;
  const std::string path = fs::canonical(folder, error);
  struct statx facts = {};
  if (error || statx(AT_FDCWD, path.c_str(), AT_STATX_DONT_SYNC, STATX_MNT_ID, &facts) != 0) {
    return std::nullopt;
  }
  for (const KernelMount& mount : ReadMounts("/proc/self")) {
    if (mount.id != static_cast<int64_t>(facts.stx_mnt_id)) continue;
    const fs::path inside = fs::path(path).lexically_relative(mount.point);
    std::string whole = (fs::path(mount.root) / inside).lexically_normal();
    if (whole.ends_with('/')) whole.pop_back();  // so that names can be appended
    return Place(mount.device, whole);
  }
  return std::nullopt;
}

// Slots by the places of their marks.
using Marks = std::map<Place, int>;

// Examines each mount namespace once, however many processes live in it.
class MarkSearch {
 public:
  explicit MarkSearch(Marks marks) : marks_(std::move(marks)) {
    // No process of a sandbox lives in our own.
    std::string own;
    if (MountNamespaceOf("/proc/self", own) == 0) known_[own] = std::nullopt;
  }

  std::optional<int> FindSlot(pid_t pid) {
    const std::string path = absl::StrCat("/proc/", pid);
    std::string space;
    const int error = MountNamespaceOf(path, space);
    if (error == 0) return SlotOfNamespace(space, path);
    if (error != ENOENT) return std::nullopt;  // another user's
    // Its first thread has ended; the others tell more. A thread that has left its namespaces too,
    // while exiting, has already released its memory and belongs to no slot.
    for (const pid_t thread : NumbersIn(path + "/task")) {
      const std::string task = absl::StrCat(path, "/task/", thread);
      if (thread == pid || MountNamespaceOf(task, space) != 0) continue;
      if (const std::optional<int> slot = SlotOfNamespace(space, task)) return slot;
    }
    return std::nullopt;
  }

 private:
  std::optional<int> SlotOfNamespace(const std::string& space, const std::string& path) {
    if (const auto known = known_.find(space); known != known_.end()) return known->second;
    const std::vector<KernelMount> mounts = ReadMounts(path);
    // It has just died, which says nothing about the others.
    if (mounts.empty()) return std::nullopt;
    std::optional<int>& slot = known_[space];
    for (const KernelMount& mount : mounts) {
      std::string_view place = mount.root;
      if (place.ends_with(kDeleted)) place.remove_suffix(kDeleted.size());
      const auto mark = marks_.find({mount.device, std::string(place)});
      if (mark != marks_.end() && !slot.has_value()) slot = mark->second;
    }
    return slot;
  }

  const Marks marks_;
  std::map<std::string, std::optional<int>> known_;
};

std::map<int, std::string> FindUsers(int64_t uid_base, int first, int count) {
  std::map<int, std::string> found;
  for (const pid_t pid : NumbersIn("/proc")) {
    const std::optional<StatusFacts> facts = Living(absl::StrCat("/proc/", pid));
    if (!facts.has_value()) continue;
    int64_t slot = facts->user - uid_base;
    if (slot >= kSimUsers) slot -= kSimUsers;
    if (slot >= first && slot < first + count) Append(pid, *facts, found[static_cast<int>(slot)]);
  }
  return found;
}

std::map<int, std::string> FindMarks(const std::string& folder, int first, int count) {
  std::map<int, std::string> found;
  // Without a mark folder there has never been a lease.
  const std::optional<Place> place = FindPlace(folder);
  if (!place.has_value()) return found;
  Marks marks;
  for (int slot = first; slot < first + count; ++slot) {
    marks[{place->first, absl::StrCat(place->second, "/", slot)}] = slot;
  }
  MarkSearch search(std::move(marks));
  for (const pid_t pid : NumbersIn("/proc")) {
    const std::optional<int> slot = search.FindSlot(pid);
    if (!slot.has_value()) continue;
    const std::optional<StatusFacts> facts = Living(absl::StrCat("/proc/", pid));
    if (facts.has_value()) Append(pid, *facts, found[*slot]);
  }
  return found;
}

}  // namespace

absl::Status SlotProcesses::Claim(LeaseOrder& order) const {
  if (uid_base_ >= 0) {
    order.uid = uid_base_ + order.slot;
    return absl::OkStatus();
  }
  std::error_code error;
  order.slot_mark = absl::StrCat(folder_, "/", order.slot);
  fs::create_directories(order.slot_mark, error);
  if (!error) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat(order.slot_mark, ": can't be created: ", error.message()));
}

std::map<int, std::string> SlotProcesses::Find(int first, int count) const {
  return uid_base_ >= 0 ? FindUsers(uid_base_, first, count) : FindMarks(folder_, first, count);
}

}  // namespace myograde::server
