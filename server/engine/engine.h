// The heart of the daemon: one thread that decides and acts (EngineCore), and a queue
// through which the threads of the API ask it for changes.
#pragma once

#include <atomic>
#include <string>

#include "server/engine/command_queue.h"
#include "server/engine/engine_core.h"

namespace myograde::server {

class Engine {
 public:
  // All but `options` must outlive it.
  Engine(EngineOptions options, Disk& disk, ReaderPool& readers, Processes& processes,
         const Clock& clock);
  ~Engine();

  // As EngineCore::Recover; before Run().
  absl::Status Recover() { return core_.Recover(); }

  // The loop; returns after Stop(), when every runner is dead and every lease
  // that ran is back in the queue. An error: the store or the state is beyond
  // repair; start again.
  absl::Status Run();
  // Safe to call from a signal handler and from any thread.
  void Stop();

  // Requests; safe from any thread, answered within `timeout`. Besides the
  // errors of EngineCore's: CancelledError while stopping, ResourceExhaustedError
  // when too many wait, DeadlineExceededError.
  // True if the artefact is new; an error as of Writer::AddUpload, and then nothing is.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact, const NewUpload& upload,
                                   const UnsubmittedLimits& limits, absl::Duration timeout);
  // An Accepted that is linked is an earlier submission's; nothing new will run.
  // NotFoundError if the artefact's files are not there any more.
  absl::StatusOr<Accepted> Submit(const NewSubmission& submission, const AdmissionRules& rules,
                                  const std::string& who, absl::Duration timeout);
  absl::StatusOr<Accepted> Rerun(const NewRerun& rerun, const std::string& who, bool organiser,
                                 const RerunLimits& limits, absl::Duration timeout);
  // Any other change of the store that no running lease depends on; `change` owns
  // what it touches. `effect` follows on the loop's thread once it is written.
  absl::Status Change(StoreChange change, absl::Duration timeout,
                      std::function<absl::Status()> effect = nullptr);
  absl::StatusOr<CancelReport> Cancel(int64_t submission, const std::string& why,
                                      const std::string& who, absl::Duration timeout);

  // Views for answers; safe from any thread, never wait for a runner or the disk.
  QueueOutlook OutlookOf(int64_t evaluation) const { return core_.OutlookOf(evaluation); }
  std::map<int64_t, LiveLease> Running() const { return core_.Running(); }
  LiveHealth Health() const { return core_.Health(); }

 private:
  void Poll(absl::Duration timeout);

  // From other threads: `effect` follows once `change` is written.
  absl::Status Ask(StoreChange change, std::function<absl::Status()> effect,
                   absl::Duration timeout);
  absl::StatusOr<Accepted> Admit(std::function<absl::StatusOr<Accepted>(Writer&)> add,
                                 absl::Duration timeout);

  const std::string data_dir_;
  const Clock& clock_;
  CommandQueue commands_;
  EngineCore core_;
  std::atomic<bool> stop_ = false;
};

}  // namespace myograde::server
