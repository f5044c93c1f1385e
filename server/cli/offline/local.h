// A policy graded on this host without a daemon: the same runner, simulator and scoring, nothing
// stored. The steps that the verbs share: gather what is to be played, check the submission, and
// PlayLocally.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <string>
#include <vector>

#include "server/artefact/artefact.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"
#include "server/config/server_config.h"
#include "server/grading/tracks.h"
#include "server/store/rows.h"

namespace myograde::server {

// What server.json says on this host.
absl::StatusOr<ServerConfig> BuildServerConfig(const HostOptions& host);

struct LocalOrder {
  TrackPtr track;
  std::vector<uint64_t> seeds;  // of the episodes to play
  Artefact artefact;
  std::string artefact_dir;
  std::vector<std::string> runtimes;  // host folders
  std::string work_dir;               // empty, owned by the caller
  std::string cache_dir;
  std::string log_dir;                // of the episodes' logs; "": none are kept
  int slots = 1;
  ServerConfig config;
};

struct LocalResult {
  std::vector<EpisodeRow> rows;  // by index
  Json outputs;                  // of the leases, in order
  bool interrupted = false;
};

// Plays every lease, up to `slots` at once, and shows progress named `what`. InternalError if a
// lease failed by the grader's fault more often than the config allows retries; each retry waits as a
// daemon's does, and is reported on standard error if `report_retries`. After a stop signal what is
// running is killed within a second and the rows so far are returned.
absl::StatusOr<LocalResult> PlayLocally(const LocalOrder& order, const std::string& what,
                                        bool report_retries);

struct LocalOptions {
  HostOptions host;
  std::string path;
  std::string track;
  std::string profile;
  std::string seeds;
  std::string logs;      // "": none are kept
  int64_t episodes = 0;  // 0: not given
  int slots = 0;         // 0: as server.json says
  bool full_hashes = false;
  bool json = false;
};

// An order with track, seeds, this host's configuration and nothing of the submission.
// InvalidArgumentError or NotFoundError: an option or a config file.
absl::StatusOr<LocalOrder> MakeLocalOrder(const LocalOptions& options);

// Packs and unpacks the submission at `path` below the folder `temp`, as an upload for the order's
// track would be. `name`: of PackArtefact. InvalidArgumentError or NotFoundError: the submission.
absl::Status TakeSubmission(const std::string& path, const std::string& name,
                            const std::string& temp, LocalOrder& order);

// Finds the folders of the runtimes that the submission names. InvalidArgumentError: this host has
// none of a name; InternalError: it is not set up.
absl::Status TakeRuntimes(LocalOrder& order);

// Whether the submission's command can start here. InvalidArgumentError: it can't.
absl::Status CheckLocalProgram(const std::string& path, const LocalOrder& order);

// An episode as `local` prints it.
Json LocalRowJson(const EpisodeRow& row);

}  // namespace myograde::server
