// Slurm's commands for the doctor: found, run to their end, and read.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/base/child_process.h"
#include "server/config/slurm_config.h"

namespace myograde::server {

// What a command prints; an error says how it failed, with its last line.
class SlurmTools {
 public:
  // `config` must outlive it.
  explicit SlurmTools(const SlurmConfig& config) : config_(config) {}

  // Errors of SlurmCommand and RunProgram; UnavailableError: it ended with another status than 0.
  absl::StatusOr<ProgramEnd> Run(const std::string& name, const std::vector<std::string>& words,
                                 absl::Duration deadline = absl::Seconds(30)) const;

 private:
  const SlurmConfig& config_;
};

// The keys and values of "KEY=VALUE KEY=VALUE" and of lines "KEY = VALUE".
std::map<std::string, std::string> ReadSlurmPairs(std::string_view text);

}  // namespace myograde::server
