// The grader's self-test on this host: one episode of a track, with a policy that exits at once,
// through the same runner, sandboxes, simulator and bridge as any lease. The expected result is
// known: one record of a crash with the policy's exit status, and a lease that ended well.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <absl/time/time.h>

#include "protocol/lease/lease.h"
#include "server/executor/executor.h"
#include "server/runner/lease_report.h"

namespace myograde::server {

// The order of the self-test; the caller adds uid and slot. `artefact_dir` is an empty folder.
LeaseOrder SelfTestOrder(const TrackConfig& track, const std::string& artefact_dir,
                         const std::string& work_dir, const std::string& cache_dir);

class SelfTest {
 public:
  // Starts the test; it fails if it has not ended by `deadline`.
  SelfTest(Executor& executor, const LeaseOrder& order, absl::Duration deadline);

  // Reads the runner's output. nullopt: still running. Otherwise the verdict: "" if the host
  // passed, or what went wrong, in one sentence.
  std::optional<std::string> Poll(absl::Duration now);

  const Runner* runner() const { return runner_.get(); }  // null if it could not be started
  std::unique_ptr<Runner> TakeRunner() { return std::move(runner_); }
  const LeaseOrder& order() const { return order_; }
  absl::Duration deadline() const { return deadline_; }

 private:
  std::string Result();

  const LeaseOrder order_;
  const absl::Duration deadline_;
  std::unique_ptr<Runner> runner_;
  LeaseReport report_;
  std::optional<EpisodeFacts> facts_;
};

}  // namespace myograde::server
