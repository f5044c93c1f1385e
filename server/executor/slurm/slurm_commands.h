// Slurm's commands, each a process with a deadline: its daemon may be down, its answer slow or lost.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/config/slurm_config.h"
#include "server/executor/slurm/job_needs.h"
#include "server/executor/slurm/job_state.h"

namespace myograde::server {

// A job array to submit.
struct BatchOrder {
  std::string batch;   // its comment, by which it is found again
  std::string script;  // of each task, which finds its part by SLURM_ARRAY_TASK_ID
  int64_t tasks = 0;
  JobNeeds needs;
  std::vector<std::string> exclude;  // nodes
};

class SlurmCommands {
 public:
  // Of one command; its answer is lost then.
  static constexpr absl::Duration kDeadline = absl::Seconds(30);

  // All jobs have the name `job_name`, by which they are found. `stopped` ends a running command.
  SlurmCommands(SlurmConfig config, std::string job_name, std::function<bool()> stopped,
                absl::Duration deadline = kDeadline);

  // Submits an array, and returns its job's number. FailedPreconditionError: the cluster refuses it,
  // and why. Any other error leaves open whether it was accepted.
  absl::StatusOr<int64_t> Submit(const BatchOrder& order) const;

  // All tasks of that name that the cluster still remembers. An error says nothing about any job.
  absl::StatusOr<std::vector<SlurmJob>> Queue() const;

  // The nodes of the partition that Slurm gives jobs.
  absl::StatusOr<std::vector<std::string>> Nodes() const;

  // Has tasks ended. OkStatus says only that the cluster was told so.
  absl::Status Cancel(const std::vector<SlurmJob>& jobs) const;
  // The same of all of that name.
  absl::Status CancelAll() const;

 private:
  absl::StatusOr<std::string> Run(const std::string& program, std::vector<std::string> words,
                                  const std::string& input) const;

  const SlurmConfig config_;
  const std::string job_name_;
  const std::function<bool()> stopped_;
  const absl::Duration deadline_;
};

// Lines of squeue with kQueueFormat. InternalError: one is of another form, and which.
extern const char kQueueFormat[];
absl::StatusOr<std::vector<SlurmJob>> ParseQueue(const std::string& text);

}  // namespace myograde::server
