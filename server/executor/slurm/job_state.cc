#include "server/executor/slurm/job_state.h"

#include <sys/wait.h>

#include <iterator>

#include <absl/strings/str_cat.h>

#include "server/executor/spool/forms.h"

namespace myograde::server {
namespace {

struct Named {
  std::string_view slurm;
  JobState state;
};

constexpr Named kStates[] = {
    {"PENDING", JobState::kWaiting},        {"CONFIGURING", JobState::kWaiting},
    {"REQUEUED", JobState::kWaiting},       {"REQUEUE_FED", JobState::kWaiting},
    {"REQUEUE_HOLD", JobState::kWaiting},   {"RESV_DEL_HOLD", JobState::kWaiting},
    {"SPECIAL_EXIT", JobState::kWaiting},   {"RUNNING", JobState::kRunning},
    {"SUSPENDED", JobState::kRunning},      {"STOPPED", JobState::kRunning},
    {"SIGNALING", JobState::kRunning},      {"RESIZING", JobState::kRunning},
    {"STAGE_OUT", JobState::kRunning},      {"COMPLETING", JobState::kEnding},
    {"COMPLETED", JobState::kDone},         {"FAILED", JobState::kFailed},
    {"TIMEOUT", JobState::kTimeLimit},      {"DEADLINE", JobState::kTimeLimit},
    {"OUT_OF_MEMORY", JobState::kMemory},   {"NODE_FAIL", JobState::kNodeLost},
    {"BOOT_FAIL", JobState::kNodeLost},     {"PREEMPTED", JobState::kPreempted},
    {"REVOKED", JobState::kCancelled},      {"CANCELLED", JobState::kCancelled},
};

}  // namespace

JobState JobStateOf(std::string_view slurm) {
  for (const Named& named : kStates) {
    if (named.slurm == slurm) return named.state;
  }
  return JobState::kFailed;
}

bool IsOver(JobState state) {
  return state != JobState::kWaiting && state != JobState::kRunning && state != JobState::kEnding;
}

std::string HowItEnded(JobState state) {
  switch (state) {
    case JobState::kTimeLimit: return "reached its time limit";
    case JobState::kMemory: return "used more memory than a lease's job may have";
    case JobState::kNodeLost: return "was lost with its node";
    case JobState::kPreempted: return "was preempted";
    case JobState::kCancelled: return "was cancelled";
    case JobState::kFailed: return "failed";
    default: return "ended";
  }
}

// The shell's statuses, and myograde-node's (forms.h).
std::string WhyItFailed(int wait_status) {
  if (WIFSIGNALED(wait_status)) return absl::StrCat("it was ended by signal ", WTERMSIG(wait_status));
  const int status = WEXITSTATUS(wait_status);
  switch (status) {
    case 0: return "";
    case 126:
    case 127: return "the node has no myograde-node that it can run (\"bin_dir\" of server.json)";
    case kNodeUnreachable:
      return "the node can't reach the daemon; check \"url\" (or \"shared_dir\") of server.json, and "
             "the node's route and firewall";
    case kNodeUntrusted:
      return "the node does not trust the TLS certificate at \"url\" of server.json; check \"ca_file\", "
             "a file on the node, and that the certificate is for the host of \"url\"";
    case kNodeClock:
      return "the TLS certificate at \"url\" of server.json is not valid by the node's clock; set that "
             "clock, or renew the certificate";
    case kNodeCaFile:
      return "the node can't read the certificate of the authority in \"ca_file\" of server.json, by "
             "which it would check the TLS certificate at \"url\"; put it there";
    default: break;
  }
  return status > 128 ? absl::StrCat("it was ended by signal ", status - 128)
                      : absl::StrCat("its exit status was ", status);
}

std::string SlurmJob::id() const { return absl::StrCat(array, "_", task); }

}  // namespace myograde::server
