// Files of the kernel: how this process reads and writes them, and what a policy may read of /proc
// and /dev. Whatever counts or lists the whole host would let two
// sandboxes signal to each other: beside its own processes, a sandbox sees a short list of files
// whose content does not change during a lease.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>

#include "server/sandbox/sandbox.h"
#include "server/sandbox/stage.h"

namespace myograde::server {

// The content of a small kernel file; "" if it can't be read. Doesn't use streams, as it is called
// many times per second of a lease.
std::string ReadKernelFile(const std::string& path);

// Writes `text` in one call, as kernel files want it. False: errno says why.
bool WriteKernelFile(const std::string& path, const std::string& text);

// What follows `key` in the first line of `text` that begins with it, without blanks around; "" if
// none does.
std::string KernelValue(std::string_view text, std::string_view key);
// The same as a number, which ends at a blank; `otherwise` if there is none.
int64_t KernelNumber(std::string_view text, std::string_view key, int64_t otherwise = 0);

// The number at `index` of a setting below /proc/sys; 0 if there is none.
int64_t KernelSetting(const std::string& name, int index);

// A mount, from a line of a mountinfo file, whose escapes are undone.
struct KernelMount {
  int64_t id = 0;
  std::string device;             // MAJOR:MINOR of its file system
  std::string root;               // what of the file system is mounted
  std::string point;              // where
  std::string type;               // of the file system
  std::set<std::string> options;  // likewise
};
std::vector<KernelMount> MountsIn(const std::string& mountinfo);

// Mounts for a sandbox that already has /proc and /dev: covers each name of this host's /proc that
// others than root can read, with a file of the list, or with nothing. /proc/sys has a list of its
// own. There are no terminals. `memory_bytes`: what /proc/meminfo says is free.
// A name that the kernel adds to /proc later, with a module, is not covered.
absl::StatusOr<std::vector<SandboxMount>> StageKernelFiles(const Stage& stage,
                                                           int64_t memory_bytes);

}  // namespace myograde::server
