// Which job plays which attempt of a lease: a state machine over the cluster's answers, without
// clock, disk or process. Attempts of an evaluation are submitted as the tasks of a job array. A job
// of this store's that plays no attempt that is still wanted is a stray, and is cancelled for as long
// as the cluster shows it, whatever was asked before and wherever it came from: an attempt that was
// ended, an answer that was lost, an earlier daemon.
//
// Times are monotonic, as a duration since an arbitrary start. An answer of the cluster's counts from
// when it was asked for.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/executor/slurm/job_state.h"
#include "server/executor/slurm/slurm_commands.h"

namespace myograde::server {

// An attempt's job.
struct JobView {
  // What the latest answer said; kWaiting before its first.
  JobState state = JobState::kWaiting;
  std::string id;      // "12_0"; "": it is not submitted yet
  std::string node;    // "": none yet
  std::string reason;
  int wait_status = 0;
  absl::Duration seen;        // when that answer was asked for; -InfiniteDuration(): none yet
  absl::Duration over_since;  // InfiniteDuration(): it is not over
  bool missing = false;       // it is over as the cluster does not show it any more
};

class JobTable {
 public:
  // How long attempts of an evaluation wait for others to share their array.
  static constexpr absl::Duration kGather = absl::Milliseconds(200);
  // From one refused or lost sbatch to the next, doubled up to the most.
  static constexpr absl::Duration kRetry = absl::Seconds(5);
  static constexpr absl::Duration kMostRetry = absl::Seconds(60);
  // A job that was not shown in so many answers is over.
  static constexpr int kMissingAnswers = 2;
  // An attempt that was removed is forgotten by then, though its job is still shown.
  static constexpr absl::Duration kForget = absl::Seconds(60);
  // A job whose node has said its last word leaves by itself; after that it is a stray.
  static constexpr absl::Duration kLeave = absl::Seconds(30);

  explicit JobTable(int array_size) : array_size_(array_size) {}

  // An attempt to submit. `name` is unique.
  void Add(const std::string& name, int64_t evaluation, const JobNeeds& needs, absl::Duration now);
  // It is not wanted any more. `leaves`: its job is about to end by itself.
  void Remove(const std::string& name, bool leaves, absl::Duration now);
  // Whether a removed attempt has no job any more, as far as can be known.
  bool gone(const std::string& name, absl::Duration now) const;
  void Forget(const std::string& name);

  // The next array to submit, whose tasks are `names`. Nothing while sbatch is in trouble, until
  // its next turn. The caller answers with one of the three below before it asks again.
  struct Batch {
    std::vector<std::string> names;
    JobNeeds needs;
  };
  std::optional<Batch> Next(absl::Duration now);
  void Accepted(const Batch& batch, int64_t array);
  void Refused(const Batch& batch, const std::string& why, absl::Duration now);
  // Its answer was lost: the next answer of squeue tells whether there is a job.
  void Lost(const Batch& batch, const std::string& comment, const std::string& why,
            absl::Duration now);

  // What squeue answered when asked at `asked`; returns the strays to cancel.
  std::vector<SlurmJob> See(const std::vector<SlurmJob>& jobs, absl::Duration asked);
  // Jobs of attempts that were removed since, which the cluster need not be asked about first.
  std::vector<SlurmJob> TakeStrays();
  bool has_strays() const { return !strays_.empty(); }

  // nullptr: there is no such attempt.
  const JobView* Find(const std::string& name) const;

  // Why nothing can be submitted, and since when; "": the latest sbatch was accepted, or nobody waits
  // for the next, which a new attempt may try.
  std::string trouble() const;
  absl::Duration trouble_since() const { return trouble_since_; }
  bool empty() const { return attempts_.empty(); }
  // When Next() may have something, if nothing changes before; InfiniteDuration(): never.
  absl::Duration next_at() const;

 private:
  struct Attempt {
    int64_t evaluation = 0;
    JobNeeds needs;
    absl::Duration added;
    bool ready = true;    // to be submitted
    bool wanted = true;
    absl::Duration removed;
    absl::Duration cancel_at;  // once it was removed
    int missed = 0;       // answers in a row that did not show it
    JobView job;
  };
  // Whether there is such a job is not known.
  struct LostBatch {
    std::vector<std::string> names;
    absl::Duration at;
  };
  void Trouble(const std::string& why, absl::Duration now);
  void NoTrouble();
  void Place(const std::vector<std::string>& names, int64_t array);
  bool IsStray(const SlurmJob& job, absl::Duration asked);
  void PlaceLost(const std::vector<SlurmJob>& jobs, absl::Duration asked);
  Attempt* AttemptOf(const SlurmJob& job);
  void NotShown(absl::Duration asked);

  const size_t array_size_;
  std::map<std::string, Attempt> attempts_;
  std::map<int64_t, std::vector<std::string>> arrays_;  // names of the tasks, by job
  std::map<std::string, LostBatch> lost_;               // by comment
  std::vector<SlurmJob> strays_;
  bool asking_ = false;  // a batch that Next gave is not answered
  std::string trouble_;
  absl::Duration trouble_since_;
  absl::Duration retry_ = kRetry;
  absl::Duration retry_at_ = -absl::InfiniteDuration();
};

}  // namespace myograde::server
