// Leases run as jobs of a Slurm cluster. The engine's thread only ever exchanges notes with three
// others, each of which may hang without the daemon: one talks to Slurm, one writes orders, one
// reads what nodes write (README.md).
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"
#include "server/config/slurm_config.h"
#include "server/executor/executor.h"
#include "server/executor/slurm/attempt_verdict.h"
#include "server/executor/slurm/job_table.h"
#include "server/executor/slurm/lease_reader.h"
#include "server/executor/slurm/node_health.h"
#include "server/executor/slurm/order_writer.h"
#include "server/executor/slurm/slurm_commands.h"
#include "server/executor/spool/spool_door.h"

namespace myograde::server {

struct SlurmOptions {
  SlurmConfig config;
  std::string store_id;     // letters and digits that tell this store from all others: jobs and the
                            // spool are named after it
  std::string held_back;    // why neither spool nor jobs may be touched; "": they may
  std::string data_dir;     // the daemon's; logs go to its folder "logs"
  std::string cache_dir;    // of models, where the config names none for the nodes
  std::string configs_dir;  // on the nodes, of sandbox/ and reference/
  std::string bin_dir;      // of programs, where the config names none for the nodes
  int64_t uid_base = -1;    // of the sandboxes' users on nodes where root runs jobs; -1: none
  int64_t log_bytes = 0;    // largest packed log of an episode
  OrderWriter::Grader grader;
  // Of one of Slurm's commands.
  absl::Duration command_deadline = SlurmCommands::kDeadline;
};

class SlurmExecutor : public Executor {
 public:
  // Returns at once: the spool is emptied, and jobs of an earlier daemon are cancelled, by the
  // threads; CannotStart() says so until they have. An error names what in the config is wrong.
  static absl::StatusOr<std::unique_ptr<SlurmExecutor>> Make(SlurmOptions options);
  // REQUIRES: all runners are destroyed. Cancels all jobs, within about two seconds unless a disk
  // hangs.
  ~SlurmExecutor() override;

  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                const LeaseSubject& subject) override;
  // The work folder is on the node, which removes it.
  void CleanUp(const std::string&) override {}
  bool remote() const override { return true; }
  int wake_fd() const override { return wake_.get(); }
  void Attend() override;
  std::string CannotStart() const override;
  void NoteEnd(const std::string& node, bool fault) override;
  std::vector<NodeView> Nodes() const override;
  absl::Status Drain(const std::string& node, const std::string& why) override;
  absl::Status Admit(const std::string& node) override;
  std::vector<DrainedNode> TakeDrained() override;

  // How nodes without the shared folder get their leases; nullptr where they have it.
  LeaseDoor* door() { return door_.get(); }

 private:
  friend class SlurmRunner;

  // One attempt of a lease, shared by its runner and the threads; guarded by the mutex.
  struct Attempt {
    std::string name;
    int64_t evaluation = 0;
    JobNeeds needs;
    NodeOrder order;           // until it is written
    std::string artefact;
    std::string artefact_dir;
    std::string grader;        // that its node must have
    std::string token;
    AttemptView view;
    absl::Duration looked = -absl::InfiniteDuration();  // its folder was last read
    std::vector<LeaseRecord> records;  // not taken by the engine yet
    std::string broken;
    std::string lost;
    std::optional<NodeEnd> end;   // of the runner
    std::optional<NodeEnd> used;  // of a node that gave it back, for its account
    bool over = false;      // a verdict was given, or its node's last word is here
    bool released = false;  // the engine has asked for its end
    bool counted = false;   // among its node's running leases
  };
  using Attempts = std::map<std::string, std::shared_ptr<Attempt>>;

  // What the writing thread is to do, in this order of urgency.
  struct Task {
    enum class Kind { kStop, kRemove, kWrite };
    Kind kind;
    std::string name;
  };
  // Since when a thread has been busy with one thing; InfiniteDuration(): it is not.
  struct Busy {
    absl::Duration since = absl::InfiniteDuration();
  };

  explicit SlurmExecutor(SlurmOptions options, std::string epoch);
  absl::Status Begin();
  void Wake() const;
  absl::Duration Now() const;

  // For runners.
  void Release(Attempt& attempt) ;
  bool IsGone(const Attempt& attempt) const ;

  // Attend's parts.
  void Judge(Attempt& attempt, absl::Duration now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Clear(absl::Duration now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Why no node may play; "": one may.
  std::string WhyNoNode() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Lose(Attempt& attempt, const std::string& why) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // The thread that talks to Slurm.
  void TalkToSlurm();
  bool SubmitNext();
  void LookAtQueue();
  void LookAtNodes();
  void CancelStrays(std::vector<SlurmJob> strays);
  BatchOrder MakeBatch(const JobTable::Batch& batch, const std::string& comment)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool AnyDue() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // The thread that writes.
  bool HasTask() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void WriteSpool();
  absl::Status OpenToWrite();
  std::optional<Task> TakeTask();
  void Do(const Task& task);
  void WriteOrder(const std::string& name);
  void LookAfterSpool();
  void OpenAgain();
  void Note(const absl::Status& status);

  // The thread that reads.
  void ReadSpool();
  bool OpenToRead(std::optional<Spool>& spool);
  void Tell(Attempt& attempt, LeaseReader& reader, LeaseNews news, absl::Duration now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::vector<std::string> ToRead(absl::Duration now) ;

  const SlurmOptions options_;
  const std::string epoch_;
  const std::string job_name_;
  const std::string spool_path_;
  const AttemptLimits limits_;
  SlurmCommands commands_;
  OrderWriter writer_;         // of the writing thread
  Fd hold_;                    // likewise: on the spool
  std::optional<Spool> spool_; // likewise, once it is open; also the door's
  std::unique_ptr<SpoolDoor> door_;
  Fd wake_;

  mutable Mutex mutex_;
  Condition talk_;
  Condition write_;
  Condition read_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  Attempts attempts_ ABSL_GUARDED_BY(mutex_);
  JobTable jobs_ ABSL_GUARDED_BY(mutex_);
  NodeHealth health_ ABSL_GUARDED_BY(mutex_);
  std::deque<Task> urgent_ ABSL_GUARDED_BY(mutex_);
  std::deque<Task> tasks_ ABSL_GUARDED_BY(mutex_);
  // The spool is this daemon's, and empty of what an earlier one left. Until then no job is cancelled.
  bool emptied_ ABSL_GUARDED_BY(mutex_) = false;
  // Those of the partition, asked for while any is drained; nullopt: not known.
  std::optional<std::vector<std::string>> usable_nodes_ ABSL_GUARDED_BY(mutex_);
  absl::Duration next_nodes_ ABSL_GUARDED_BY(mutex_) = -absl::InfiniteDuration();
  std::string queue_trouble_ ABSL_GUARDED_BY(mutex_) = "Slurm has not answered yet";
  std::string spool_trouble_ ABSL_GUARDED_BY(mutex_);
  absl::Duration spool_trouble_since_ ABSL_GUARDED_BY(mutex_);
  absl::Duration next_write_ ABSL_GUARDED_BY(mutex_) = -absl::InfiniteDuration();  // of an order
  Busy writing_ ABSL_GUARDED_BY(mutex_);
  Busy reading_ ABSL_GUARDED_BY(mutex_);
  absl::Duration next_look_ ABSL_GUARDED_BY(mutex_);  // at the queue
  absl::Duration judged_ ABSL_GUARDED_BY(mutex_) = -absl::InfiniteDuration();

  std::thread talking_thread_;
  std::thread writing_thread_;
  std::thread reading_thread_;
};

}  // namespace myograde::server
