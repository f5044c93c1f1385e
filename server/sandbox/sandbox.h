// A sandbox as a value, and the process that runs in it. The value describes it completely;
// policy_sandbox.h builds the two kinds.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "protocol/base/fd.h"
#include "server/sandbox/network.h"

namespace myograde::server {

// The program that builds every sandbox.
inline constexpr char kBubblewrap[] = "/usr/bin/bwrap";

struct SandboxMount {
  enum class Kind { kReadOnly, kWritable, kSymlink, kProc, kDev, kDevice, kTmpfs, kSealed };
  Kind kind;
  std::string source;  // kReadOnly, kWritable, kDevice: host path; kSymlink: link text; else ""
  std::string target;  // kSealed: a mount to make read-only for good
};

struct SandboxLimit {
  int resource;  // RLIMIT_*
  std::string name;
  int64_t value;
};

struct SandboxSpec {
  std::vector<SandboxMount> mounts;  // in this order
  std::vector<std::pair<std::string, std::string>> environment;  // nothing else is set
  std::vector<std::string> command;
  std::string working_dir;
  bool bus = false;         // a loopback that carries LCM; otherwise no network at all
  bool as_first = false;    // the command itself is process 1
  bool held = false;        // built at once, but the command waits for Sandbox::Release()
  // Its processes do not preempt running ones when they wake up, and are preempted by any that are
  // not like this (SCHED_BATCH).
  bool batch = false;
  int64_t uid = -1;         // set before any namespace is created; -1: the caller's own
  int64_t inner_uid = 1000;  // the user and group that its processes see themselves as
  int64_t inner_gid = 1000;
  // Starts the command that follows with a limit of `tasks`; a path in the sandbox.
  std::vector<std::string> prlimit = {"/usr/bin/prlimit"};
  int64_t tasks = 0;        // RLIMIT_NPROC, set inside the sandbox' own user namespace; 0: none
  std::vector<SandboxLimit> limits;
};

nlohmann::json SandboxSpecToJson(const SandboxSpec& spec);

// Descriptors passed to the first process, which sees each as `target`.
struct SandboxFd {
  int fd;
  int target;  // 0 or above
};

// How a sandbox ended.
struct SandboxEnd {
  bool started = false;  // the command was executed
  int exit_code = -1;    // of the command; 128 + signal if killed by one
  int wait_status = 0;   // of bubblewrap itself
};

class Sandbox {
 public:
  // Starts the command. `join`: process lists of control groups, see ControlGroup::join_fds().
  // `filter`: a BPF program, or invalid. Anything that goes wrong later, in bubblewrap, ends the
  // sandbox with !started and a sentence on its stderr. Dies with the calling thread.
  static absl::StatusOr<std::unique_ptr<Sandbox>> Start(const SandboxSpec& spec,
                                                        const std::vector<SandboxFd>& fds,
                                                        const std::vector<int>& join,
                                                        const Fd& filter);
  ~Sandbox();
  Sandbox(const Sandbox&) = delete;
  Sandbox& operator=(const Sandbox&) = delete;

  // Starts the command of a held sandbox, which sees the end of a file; no effect on any other.
  void Release() { gate_.reset(); }

  // True once it has ended; never blocks.
  bool Ended();

  // Kills everything in it and waits for its end. False: something survives at `timeout`.
  bool Kill(absl::Duration timeout);

  // Kills everything in it, without waiting.
  void KillNow();

  // True once nothing of it is left; never blocks.
  bool Gone();

  // Waits for it to end by itself.
  bool Wait(absl::Duration timeout);

  // Valid once Ended().
  SandboxEnd end() const { return end_; }

  // The outermost process, the ancestor of all others.
  pid_t pid() const { return pid_; }

  // null unless the sandbox has the bus.
  const BusNetwork* network() const { return network_.has_value() ? &*network_ : nullptr; }

 private:
  Sandbox() = default;
  void ReadStatus();

  std::optional<BusNetwork> network_;
  pid_t pid_ = -1;
  bool reaped_ = false;
  Fd gate_;    // a held sandbox reads the other end
  Fd status_;  // bubblewrap's own reports
  std::string report_;
  Fd first_;   // a pidfd of process 1
  SandboxEnd end_;
};

}  // namespace myograde::server
