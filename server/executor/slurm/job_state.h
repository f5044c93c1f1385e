// What Slurm says of a job, as far as a lease depends on it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace myograde::server {

enum class JobState {
  kWaiting,    // for a node, or to be started again
  kRunning,
  kEnding,     // its processes are being ended
  kDone,
  kFailed,     // its program, or its start
  kTimeLimit,  // of the job
  kMemory,     // it used more than it may
  kNodeLost,   // its node died, or did not boot
  kPreempted,
  kCancelled,
};

// From the long form of squeue's states, such as "RUNNING". States that later versions add count as
// failed if they are not known to be anything else.
JobState JobStateOf(std::string_view slurm);

// Whether nothing of the job runs or will run any more.
bool IsOver(JobState state);

// How a job that is over ended, to follow "job 12_0 on n1 ": "was preempted".
std::string HowItEnded(JobState state);

// What the wait status of a job's script that failed tells of the reason, to follow ": "; "": nothing.
std::string WhyItFailed(int wait_status);

// One task of a job array, as squeue shows it.
struct SlurmJob {
  int64_t array = 0;
  int64_t task = 0;
  JobState state = JobState::kWaiting;
  std::string node = {};    // "": none yet
  std::string batch = {};   // the comment that it was submitted with
  std::string reason = {};  // why it waits, or how it ended, in Slurm's words
  int wait_status = 0;      // of its script, as of waitpid(2), once it is over

  // As Slurm's commands name it.
  std::string id() const;
};

}  // namespace myograde::server
