// A private place where a lease's mounts are assembled.
//
// What a sandbox must see may lie below folders that its uid can't enter, and mounting a tmpfs with
// a limit on its number of files needs the right to mount. So the runner moves into its own mount
// namespace (an ordinary user into a user namespace too, where it has that right), and puts bind
// mounts and tmpfs on a folder that only this namespace shows. All of it disappears with the
// runner.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

namespace myograde::server {

// How full a scratch tmpfs is.
struct ScratchUsage {
  int64_t bytes = 0;
  int64_t files = 0;
  int64_t free_bytes = -1;  // -1: not measured
  int64_t free_files = -1;
  bool full() const { return free_bytes == 0 || free_files == 0; }
};

class Stage {
 public:
  // Moves the calling process into its own mount namespace and stages each folder of `sources`.
  // REQUIRES: a single thread. An error names what is missing: the right to create namespaces, or
  // one of the folders.
  static absl::StatusOr<Stage> Enter(const std::vector<std::string>& sources);

  // The path of a staged source in this namespace.
  const std::string& PathOf(const std::string& source) const { return paths_.at(source); }

  // /dev/null and the like for a sandbox, by name: read-only, as anybody may set their times, which
  // the next lease would find. They belong to this lease alone, as anybody may lock them too; where
  // device nodes can't be created (an ordinary user) they are the host's.
  const std::map<std::string, std::string>& devices() const { return devices_; }

  // Adds a small file with `text`, readable by all.
  absl::StatusOr<std::string> AddFile(const std::string& name, const std::string& text) const;

  // Adds an empty folder. The folder above it exists.
  absl::StatusOr<std::string> AddFolder(const std::string& name) const;

  // Mounts a fresh tmpfs with world-writable folders tmp/ and shm/, together limited to `bytes` and
  // `files`. `number` distinguishes it from others.
  absl::StatusOr<std::string> MountScratch(int number, int64_t bytes, int64_t files) const;
  void UnmountScratch(const std::string& path) const;

  // Usage of the tmpfs at `path`, from MountScratch().
  static ScratchUsage MeasureUsage(const std::string& path);

 private:
  void MakeDevices();

  std::map<std::string, std::string> paths_;
  std::map<std::string, std::string> devices_;
};

// Whether an ordinary user may create user namespaces here; tried in a child.
bool CanMakeUserNamespace();

}  // namespace myograde::server
