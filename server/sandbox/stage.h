// A private place in which a lease's mounts are put together.
//
// What a sandbox must see may lie below folders that its uid can't enter, and a
// tmpfs with a limit on its number of files can only be mounted by who has the
// right to mount. So the runner moves into a mount namespace of its own (as an
// ordinary user: into a user namespace too, where it has that right), and
// lays bind mounts and tmpfs on a folder that only this namespace shows. With
// the runner's end all of it is gone.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

namespace myograde::server {

// What a scratch tmpfs holds, and what there is room for.
struct ScratchUsage {
  int64_t bytes = 0;
  int64_t files = 0;
  int64_t free_bytes = -1;  // -1: not measured
  int64_t free_files = -1;
  bool full() const { return free_bytes == 0 || free_files == 0; }
};

class Stage {
 public:
  // Moves the calling process into its own mount namespace and stages each
  // folder of `sources`. REQUIRES: a single thread. An error names what is
  // missing: the right to make namespaces, or one of the folders.
  static absl::StatusOr<Stage> Enter(const std::vector<std::string>& sources);

  // Where a staged source is seen now.
  const std::string& PathOf(const std::string& source) const { return paths_.at(source); }

  // Where /dev/null and the like are for a sandbox, by name: read-only, as anybody
  // may set their times, which the next lease would find. They are this lease's
  // own, as anybody may lock them too; where device nodes can't be made (an
  // ordinary user) the host's.
  const std::map<std::string, std::string>& devices() const { return devices_; }

  // A small file with `text`, readable by all.
  absl::StatusOr<std::string> AddFile(const std::string& name, const std::string& text) const;

  // Mounts a fresh tmpfs with folders tmp/ and shm/ that everyone may write to,
  // at most `bytes` and `files` together. `number` tells it from others.
  absl::StatusOr<std::string> MountScratch(int number, int64_t bytes, int64_t files) const;
  void UnmountScratch(const std::string& path) const;

  // Of the tmpfs at `path`, of MountScratch().
  static ScratchUsage UsageOf(const std::string& path);

 private:
  void MakeDevices();

  std::map<std::string, std::string> paths_;
  std::map<std::string, std::string> devices_;
};

// True once an ordinary user may make user namespaces here; tried in a child.
bool CanMakeUserNamespace();

}  // namespace myograde::server
