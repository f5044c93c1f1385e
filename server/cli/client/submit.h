// myograde submit, without what it does on this host alone (../offline/dry_run.h).
#pragma once

#include <cstdint>
#include <string>

#include <CLI/CLI.hpp>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"
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

// A phase as GET /v1/challenges has it. InvalidArgumentError: there is none of that name; else an
// error of the client.
absl::StatusOr<nlohmann::json> FindPhaseOf(const Client& client, const std::string& phase);

// Uploads, submits and, if asked to, waits; the exit status.
int Submit(SubmitOptions options);

}  // namespace myograde::server
