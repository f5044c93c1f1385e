// Options of verbs that speak to a daemon.
#pragma once

#include <cstdint>
#include <string>

#include <CLI/CLI.hpp>

#include "server/cli/client/client.h"
#include "server/cli/client/server_choice.h"

namespace myograde::server {

struct DaemonOptions : ServerOptions {
  bool json = false;

  Client client() const;
};

// Adds --ca-file.
void AddCaFile(CLI::App& verb, std::string& file);

// Adds --json, and with --server, --ca-file, --data and --socket where the daemon is. `schema` and
// `json_help` as for AddJson.
void AddDaemonOptions(CLI::App& verb, const std::string& schema, DaemonOptions& options,
                      const std::string& json_help = "Print JSON");

// Adds --data and --socket alone.
void AddPlaces(CLI::App& verb, DaemonOptions& options);

// Of verbs about one submission.
struct SubmissionOptions : DaemonOptions {
  int64_t id = 0;

  // The submission's resource in the API, or with "/result" and the like a part of it.
  std::string Resource(const std::string& part = "") const;
};

// Adds ID, the number of a submission.
void AddSubmissionId(CLI::App& verb, SubmissionOptions& options, bool required = true,
                     const std::string& help = "The submission");

}  // namespace myograde::server
