// Leases run as jobs of a Slurm cluster: to the daemon each is a process of this host, which has srun
// start the lease's other end on a node (README.md).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/mutex.h"
#include "server/config/slurm_config.h"
#include "server/executor/executor.h"
#include "server/executor/slurm/node_health.h"

namespace myograde::server {

struct SlurmOptions {
  SlurmConfig config;
  std::string store_id;     // letters and digits that tell this store from all others: jobs are named
                            // after it
  std::string held_back;    // why no job may be touched; "": they may
  std::string cache_dir;    // of models, where the config names none for the nodes
  std::string configs_dir;  // on the nodes, of sandbox/ and reference/
  std::string bin_dir;      // of programs, where the config names none for the nodes
  int64_t uid_base = -1;    // of the sandboxes' users on nodes where root runs jobs; -1: none
  int64_t log_bytes = 0;    // largest packed log of an episode
  // The daemon's GraderBuild with these adapters.
  std::function<nlohmann::json(const std::vector<std::string>& adapters)> grader;
};

class SlurmExecutor : public Executor {
 public:
  // Returns at once; a thread cancels jobs that no lease waits for, and CannotStart() says so until
  // those of an earlier daemon are.
  explicit SlurmExecutor(SlurmOptions options);
  // REQUIRES: all runners are destroyed.
  ~SlurmExecutor() override;

  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                const LeaseSubject& subject) override;
  bool remote() const override { return true; }
  std::string CannotStart() const override;
  void NoteEnd(const std::string& node, bool fault) override;
  std::vector<NodeView> Nodes() const override;
  absl::Status Drain(const std::string& node, const std::string& why) override;
  absl::Status Admit(const std::string& node) override;
  std::vector<DrainedNode> TakeDrained() override;

 private:
  class Lease;

  // The text of a ClusterOrder, for a job with this comment.
  absl::StatusOr<std::string> OrderText(const LeaseOrder& order, const LeaseSubject& subject,
                                        const std::string& comment);
  void Watch();
  // One of Slurm's commands; an error says what it said.
  absl::StatusOr<std::string> Ask(const std::string& command, std::vector<std::string> words) const;
  absl::StatusOr<std::set<std::string>> UsableNodes() const;
  absl::StatusOr<size_t> CancelStrays() const;

  const SlurmOptions options_;
  const std::string job_name_;

  mutable Mutex mutex_;
  Condition news_;
  NodeHealth health_ ABSL_GUARDED_BY(mutex_);
  // By their jobs' comments; null: it is being started.
  std::map<std::string, const Lease*> leases_ ABSL_GUARDED_BY(mutex_);
  // Why jobs of an earlier daemon are not cancelled yet; "": they are.
  std::string unseen_ ABSL_GUARDED_BY(mutex_);
  // That Slurm gives jobs, while any node is drained; none: not known.
  std::set<std::string> usable_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread watching_;
};

}  // namespace myograde::server
