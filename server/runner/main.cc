// myograde-runner: plays one lease and prints its records.
//
//   myograde-runner [--lifeline] ORDER.json
//
// ORDER.json is a LeaseOrder (protocol/lease/lease.h). One record per line on stdout, the last one
// always a lease_end. With --lifeline the lease ends when stdin does. SIGTERM and SIGINT end it
// too. Exit status: 0 all episodes were recorded, 2 wrong use, 4 trouble with the grader or its
// host.
#include <fcntl.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/base/child_process.h"
#include "server/runner/lease_runner.h"
#include "server/runner/log_keeper.h"
#include "server/sandbox/control_group.h"

namespace myograde::server {
namespace {

constexpr int kDone = 0;
constexpr int kWrongUse = 2;
constexpr int kGraderTrouble = 4;

absl::StatusOr<LeaseOrder> ReadOrder(const std::string& path) {
  ASSIGN_OR_RETURN(nlohmann::json json, ReadJsonFile(path));
  ASSIGN_OR_RETURN(LeaseOrder order, LeaseOrderFromJson(json, path));
  RETURN_IF_ERROR(CheckOrderPaths(order));
  if (order.uid == 0 || (order.uid < 0 && geteuid() == 0)) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": \"uid\" is ", order.uid,
        "; as root a lease needs an unprivileged uid of its own, above 0"));
  }
  if (order.uid > 0 && geteuid() != 0 && static_cast<uid_t>(order.uid) != geteuid()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": \"uid\" is ", order.uid, "; only root can take another uid"));
  }
  if (geteuid() != 0) order.uid = -1;
  return order;
}

absl::StatusOr<std::vector<Fd>> OpenReplays(const LeaseOrder& order) {
  std::vector<Fd> files;
  for (const std::string& path : order.replay) {
    files.emplace_back(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!files.back().valid()) {
      return absl::NotFoundError(
          absl::StrCat("the log ", path, " can't be opened: ", std::strerror(errno)));
    }
  }
  return files;
}

// The end record of a lease that could not even start.
int EndAtOnce(const absl::Status& status) {
  LeaseEndRecord end;
  end.detail = std::string(status.message());
  std::printf("%s\n", LeaseRecordToLine(end).c_str());
  std::fprintf(stderr, "myograde-runner: %s\n", Sanitized(end.detail).c_str());
  return kGraderTrouble;
}

// Simulator, bridge and policy take turns: on one processor they wake each other without waking an
// idle processor. Child processes inherit this. If it fails, nothing is lost.
void KeepToOneProcessor(int64_t slot) {
  cpu_set_t usable;
  if (sched_getaffinity(0, sizeof(usable), &usable) != 0) return;
  int64_t skip = slot % CPU_COUNT(&usable);
  for (int processor = 0; processor < CPU_SETSIZE; ++processor) {
    if (!CPU_ISSET(processor, &usable) || skip-- > 0) continue;
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(processor, &one);
    sched_setaffinity(0, sizeof(one), &one);
    return;
  }
}

// Descriptors in flight between processes count towards their user, and a process with a lower
// limit of open files than that count can send none: a policy of this user must not block this
// process with its own.
void MayHaveAllDescriptors() {
  rlimit files;
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = files.rlim_max;
  setrlimit(RLIMIT_NOFILE, &files);
}

// Plays the lease of the order at `path`. True: all episodes were recorded; an error: it could not
// even start.
absl::StatusOr<bool> Play(const std::string& path, int stop, const Fd& signals) {
  ASSIGN_OR_RETURN(LeaseOrder order, ReadOrder(path));
  if (order.pinned) KeepToOneProcessor(order.slot);
  ASSIGN_OR_RETURN(const std::string bin_dir, BinDir());
  ASSIGN_OR_RETURN(const SandboxConfig config, LoadSandboxConfig(ConfigDir()));
  order.log_bytes = config.sim.log_bytes;
  // Open them before entering the stage, where their paths may be hidden.
  std::optional<LogKeeper> logs;
  if (!order.log_dir.empty()) {
    ASSIGN_OR_RETURN(LogKeeper keeper,
                     LogKeeper::Open(order.log_dir, order.lease, order.log_bytes));
    logs.emplace(std::move(keeper));
  }
  ASSIGN_OR_RETURN(const std::vector<Fd> replays, OpenReplays(order));
  std::optional<TrajectoryFile> trajectory;
  if (!order.trajectory.empty()) {
    ASSIGN_OR_RETURN(trajectory, TrajectoryFile::Make(order.trajectory));
  }
  ControlGroup::RemoveStale();
  ASSIGN_OR_RETURN(const Stage stage, Stage::Enter(StagedSources(order, bin_dir)));
  ASSIGN_OR_RETURN(const EtcFiles etc, StageEtcFiles(order, stage));
  const LeaseContext context = {order,   config,
                                bin_dir, stage,
                                etc,     logs.has_value() ? &*logs : nullptr,
                                replays, trajectory.has_value() ? &*trajectory : nullptr};
  return LeaseRunner(context, STDOUT_FILENO, stop, signals.get()).Run();
}

int Main(int argc, char** argv) {
  const bool lifeline = argc == 3 && std::string_view(argv[1]) == "--lifeline";
  if (argc != 2 && !lifeline) {
    std::fprintf(stderr, "usage: myograde-runner [--lifeline] ORDER.json\n");
    return kWrongUse;
  }
  const Fd signals = StopSignals();
  MayHaveAllDescriptors();
  // Processes below this one that lose their parent become its children, and die with it.
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  const absl::StatusOr<bool> recorded = Play(argv[argc - 1], lifeline ? STDIN_FILENO : -1, signals);
  if (!recorded.ok()) return EndAtOnce(recorded.status());
  // Reap orphans whose parents died before them.
  while (waitpid(-1, nullptr, WNOHANG) > 0) continue;
  return *recorded ? kDone : kGraderTrouble;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
