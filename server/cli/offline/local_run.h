// A whole evaluation without a daemon: the same runner, simulator and scoring,
// nothing stored.
#pragma once

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/artefact/artefact.h"
#include "server/cli/terminal/text.h"
#include "server/config/server_config.h"
#include "server/grading/tracks.h"
#include "server/runner/lease_report.h"
#include "server/runner/runner_process.h"
#include "server/store/rows.h"

namespace myograde::server {

// Stands for a data folder's secret in local runs under configs of form 1, whose policy seeds
// a daemon takes from a secret of its own (policy_seed.h).
inline constexpr char kLocalPolicyKey[] = "myograde local run";

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

class LocalRun {
 public:
  // The first two are called several times a second, by the thread that calls Run.
  struct Hooks {
    std::function<void(int64_t done, int64_t total)> progress;  // episodes
    std::function<bool()> stopped;                              // true ends the run
    // Unless null: a sentence about episodes that a fault of the grader has played again.
    std::function<void(const std::string&)> again = nullptr;
  };

  LocalRun(LocalOrder order, Hooks hooks) : order_(std::move(order)), hooks_(std::move(hooks)) {}

  // Plays every lease, up to `slots` at once. InternalError if a lease failed
  // by the grader's fault more often than the config allows replays; each
  // replay waits as a daemon's does. When
  // stopped, what is running is killed within a second and the rows so far
  // are returned.
  absl::StatusOr<LocalResult> Run();

 private:
  struct Lease {
    int64_t first = 0;
    int64_t last = 0;
    int64_t faults = 0;
    absl::Duration not_before;  // of the next try
    std::unique_ptr<RunnerProcess> runner;
    int slot = -1;
    std::string work_dir;
    LeaseReport report;  // of this try
    std::map<int64_t, EpisodeRow> rows;
    bool done = false;
  };

  LeaseOrder OrderFor(const Lease& lease) const;
  absl::Status StartWaiting();
  absl::Status Start(Lease& lease, int slot);
  void WaitForRecords();
  void Listen(Lease& lease);
  absl::Status Finish(Lease& lease);
  void KillAll();
  LocalResult Collect(bool interrupted) const;

  LocalOrder order_;
  Hooks hooks_;
  std::vector<Lease> leases_;
};

}  // namespace myograde::server
