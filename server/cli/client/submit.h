// myograde submit, without what it does on this host alone (../offline/dry_run.h).
#pragma once

#include <absl/status/statusor.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "server/cli/client/daemon_options.h"

namespace myograde::server {

struct SubmitOptions : DaemonOptions {
  std::string path;
  std::string name;   // of the policy; "": the submission's own
  std::string track;  // "": the phase's
  std::string team;
  std::string profile;
  std::string phase;
  std::string seeds;
  int64_t episodes = 0;  // 0: not given
  bool wait = false;
  bool full_hashes = false;
};

// Adds all of them; the flag --wait is returned.
CLI::Option* AddSubmitOptions(CLI::App& verb, SubmitOptions& options);

// Neither a track nor a phase: InvalidArgumentError.
absl::Status CheckPlaceGiven(const SubmitOptions& options);

// Uploads, submits and, if asked to, waits; the exit status.
absl::StatusOr<int> Submit(SubmitOptions options);

}  // namespace myograde::server
