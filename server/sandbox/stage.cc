#include "server/sandbox/stage.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"

namespace myograde::server {
namespace {

// Hidden under our tmpfs in our namespace only. Anything in it that a sandbox needs was opened
// before.
constexpr char kStage[] = "/run";
// The folders of a scratch tmpfs, which count as files.
constexpr int64_t kOwnFiles = 3;

absl::Status Errno(std::string_view what) {
  return absl::FailedPreconditionError(
      absl::StrCat(std::string(what), ": ", std::strerror(errno)));
}

// A device that every sandbox has, with its numbers from Linux's devices.txt.
struct Node {
  const char* name;
  unsigned major;
  unsigned minor;
};
constexpr Node kNodes[] = {{"null", 1, 3},   {"zero", 1, 5},    {"full", 1, 7},
                           {"random", 1, 8}, {"urandom", 1, 9}, {"tty", 5, 0}};

// Makes the mount at `path` read-only. A device there stays writable, but its times and mode do
// not.
bool MakeReadOnly(const std::string& path) {
  struct statvfs mounted;
  if (statvfs(path.c_str(), &mounted) != 0) return false;
  unsigned long flags = MS_REMOUNT | MS_BIND | MS_RDONLY;
  // Flags that only the original mounter may clear.
  if ((mounted.f_flag & ST_NOSUID) != 0) flags |= MS_NOSUID;
  if ((mounted.f_flag & ST_NOEXEC) != 0) flags |= MS_NOEXEC;
  if ((mounted.f_flag & ST_NODEV) != 0) flags |= MS_NODEV;
  return mount("none", path.c_str(), nullptr, flags, nullptr) == 0;
}

bool MakeOwn(const Node& node, const std::string& path) {
  if (mknod(path.c_str(), S_IFCHR | 0666, makedev(node.major, node.minor)) != 0 ||
      chmod(path.c_str(), 0666) != 0) {
    return false;
  }
  // Even if it exists, a device control group may forbid opening it. Without a terminal there is
  // none to open (ENXIO).
  return Fd(open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOCTTY)).valid() || errno == ENXIO;
}

bool ShowHosts(const Node& node, const std::string& path) {
  const std::string host = absl::StrCat("/dev/", node.name);
  return Fd(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644)).valid() &&
         mount(host.c_str(), path.c_str(), nullptr, MS_BIND, nullptr) == 0 && MakeReadOnly(path);
}

absl::Status EnterNamespaces() {
  if (geteuid() != 0 && !EnterUserNamespace()) {
    return Errno(
        "this host does not let ordinary users create user namespaces (see `myograde doctor`)");
  }
  if (unshare(CLONE_NEWNS) != 0) return Errno("can't create a mount namespace");
  if (mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) {
    return Errno("can't make the mounts private");
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Stage> Stage::Enter(const std::vector<std::string>& sources) {
  RETURN_IF_ERROR(EnterNamespaces());
  std::map<std::string, Fd> trees;
  for (const std::string& source : sources) {
    Fd tree(
        open_tree(AT_FDCWD, source.c_str(), OPEN_TREE_CLONE | OPEN_TREE_CLOEXEC | AT_RECURSIVE));
    if (!tree.valid()) return Errno(absl::StrCat("can't mount ", source));
    trees[source] = std::move(tree);
  }
  if (mount("myograde", kStage, "tmpfs", MS_NOSUID | MS_NODEV, "mode=0755,size=16m") != 0) {
    return Errno(absl::StrCat("can't mount a tmpfs on ", kStage));
  }
  Stage stage;
  for (const auto& [source, tree] : trees) {
    const std::string path = absl::StrCat(kStage, "/source", stage.paths_.size());
    if (mkdir(path.c_str(), 0755) != 0 ||
        move_mount(tree.get(), "", AT_FDCWD, path.c_str(), MOVE_MOUNT_F_EMPTY_PATH) != 0) {
      return Errno(absl::StrCat("can't mount ", source, " for the sandbox"));
    }
    stage.paths_[source] = path;
  }
  stage.MakeDevices();
  return stage;
}

void Stage::MakeDevices() {
  const std::string folder = absl::StrCat(kStage, "/devices");
  if (mkdir(folder.c_str(), 0755) != 0 ||
      mount("devices", folder.c_str(), "tmpfs", MS_NOSUID | MS_NOEXEC, "mode=0755,size=64k") != 0) {
    return;
  }
  for (const bool own : {true, false}) {
    std::map<std::string, std::string> made;
    for (const Node& node : kNodes) {
      const std::string path = absl::StrCat(folder, own ? "/own-" : "/host-", node.name);
      if (own ? MakeOwn(node, path) : ShowHosts(node, path)) made[node.name] = path;
    }
    if (made.size() < std::size(kNodes) && own) continue;
    devices_ = std::move(made);
    break;
  }
  MakeReadOnly(folder);
}

absl::StatusOr<std::string> Stage::AddFile(const std::string& name,
                                           const std::string& text) const {
  const std::string path = absl::StrCat(kStage, "/", name);
  Fd file(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!file.valid() ||
      write(file.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()) ||
      fchmod(file.get(), 0644) != 0) {
    return Errno(absl::StrCat("can't write ", path));
  }
  return path;
}

absl::StatusOr<std::string> Stage::AddFolder(const std::string& name) const {
  const std::string path = absl::StrCat(kStage, "/", name);
  if (mkdir(path.c_str(), 0755) != 0 || chmod(path.c_str(), 0755) != 0) {
    return Errno(absl::StrCat("can't create ", path));
  }
  return path;
}

absl::StatusOr<std::string> Stage::MountScratch(int number, int64_t bytes, int64_t files) const {
  const std::string path = absl::StrCat(kStage, "/scratch", number);
  const std::string options =
      absl::StrCat("mode=0755,size=", bytes, ",nr_inodes=", files + kOwnFiles);
  if (mkdir(path.c_str(), 0755) != 0 ||
      mount("scratch", path.c_str(), "tmpfs", MS_NOSUID | MS_NODEV, options.c_str()) != 0) {
    return Errno("can't mount a scratch tmpfs");
  }
  for (const char* folder : {"/tmp", "/shm"}) {
    const std::string below = path + folder;
    if (mkdir(below.c_str(), 0777) != 0 || chmod(below.c_str(), 01777) != 0) {
      return Errno("can't create the scratch folders");
    }
  }
  return path;
}

void Stage::UnmountScratch(const std::string& path) const {
  umount2(path.c_str(), MNT_DETACH);
  rmdir(path.c_str());
}

ScratchUsage Stage::MeasureUsage(const std::string& path) {
  struct statvfs usage;
  if (statvfs(path.c_str(), &usage) != 0) return {};
  const auto block = static_cast<int64_t>(usage.f_frsize);
  return {static_cast<int64_t>(usage.f_blocks - usage.f_bfree) * block,
          static_cast<int64_t>(usage.f_files - usage.f_ffree) - kOwnFiles,
          static_cast<int64_t>(usage.f_bavail) * block, static_cast<int64_t>(usage.f_favail)};
}

bool CanMakeUserNamespace() {
  const pid_t child = fork();
  if (child == 0) _exit(unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0 ? 0 : 1);
  int status = 1;
  return child > 0 && waitpid(child, &status, 0) == child && status == 0;
}

}  // namespace myograde::server
