// What Slurm's commands are told, and what they answer, as far as a lease depends on it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/track_config.h"
#include "server/config/slurm_config.h"

namespace myograde::server {

// Words of srun(1) for a lease of a track with these budgets, which may take `wall`: the config's
// options, and what the job needs, by the config and, where that leaves it open, by the budgets.
// Later words win, so that no option of the config can change the needs.
std::vector<std::string> JobWords(const SlurmConfig& config, const Budgets& budgets,
                                  absl::Duration wall);

// The path of one of Slurm's commands. FailedPreconditionError: there is none, and what to do.
absl::StatusOr<std::string> SlurmCommand(const SlurmConfig& config, const std::string& name);

// A line that one of Slurm's commands said, without "NAME: error: " before it.
std::string WithoutName(std::string_view line, std::string_view name);

// What the command at `path` prints, with nothing of this process' environment but what
// SlurmEnvironment leaves. UnavailableError: it failed, and what it said; else errors of
// RunProgram.
absl::StatusOr<std::string> RunSlurm(
    const std::string& path, std::vector<std::string> words, absl::Duration deadline,
    const std::function<bool()>& stopped = [] { return false; });

// A job of a store's, as squeue shows it.
struct SlurmJob {
  std::string id = {};
  std::string state = {};    // in Slurm's words, such as "RUNNING"
  std::string node = {};     // "": none yet
  std::string comment = {};  // that it was submitted with
  std::string reason = {};   // why it waits, or how it ended, in Slurm's words

  // Whether nothing of it runs or will run any more.
  bool over() const;
  // How one that is over ended, to follow "job 12 on n1 ": "was preempted".
  std::string HowItEnded() const;
  // It ended by a limit of its own, which is the grader's fault.
  bool AtALimit() const;
};

// Words of squeue(1) for all jobs of that name that the cluster still remembers, and its answer.
// InternalError: a line is of another form, and which.
std::vector<std::string> QueueWords(const std::string& job_name);
absl::StatusOr<std::vector<SlurmJob>> ParseQueue(std::string_view text);

// Asks Slurm's sstat for the energy that the running job's step has used so far, in joules.
// nullopt: this is not a job (SLURM_JOB_ID), or the cluster does not measure it or does not answer
// soon.
std::optional<double> EnergyOfJob();

// Of sstat's answer. 0 stands for what is not measured.
std::optional<double> ParseEnergy(std::string_view answer);

}  // namespace myograde::server
