#include "server/executor/slurm/job_state.h"

#include <iterator>

#include <absl/strings/str_cat.h>

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

std::string SlurmJob::id() const { return absl::StrCat(array, "_", task); }

}  // namespace myograde::server
