// The daemon's engine: one thread that decides and acts (EngineCore), and a queue through which API
// threads request changes.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/engine/engine_core.h"

namespace myograde::server {

// Hands work from the HTTP threads to the daemon's loop. Bounded; every caller waits for its answer
// with a deadline.
class CommandQueue {
 public:
  // REQUIRES: capacity > 0.
  explicit CommandQueue(size_t capacity);

  // Readable while commands are queued.
  int wake_fd() const { return wake_.get(); }

  // Reports a command's status. Call it exactly once, at any later time, on the loop's thread.
  using Answer = std::function<void(absl::Status)>;
  // Runs `command` on the loop's thread and waits until its Answer is called.
  // ResourceExhaustedError: the queue is full. CancelledError: the daemon is stopping.
  // DeadlineExceededError: no answer in time; the command may still run, so it must own everything
  // that it touches.
  absl::Status Call(std::function<void(Answer)> command, absl::Duration timeout);

  // Loop thread only: runs the queued commands and returns how many there were.
  int RunAll();

  // Makes the loop's poll return; safe to call from a signal handler.
  void Wake();

  // Answers every queued and every later command with CancelledError.
  void Close();

 private:
  struct Entry {
    std::function<void(Answer)> command;
    std::shared_ptr<std::promise<absl::Status>> answer;
  };

  const size_t capacity_;
  Fd wake_;  // an eventfd
  Mutex mutex_;
  std::deque<Entry> entries_ ABSL_GUARDED_BY(mutex_);
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

struct RejudgePlan;  // server/engine/rejudges.h

// What follows from an act on a rejudge.
using AfterRejudge = std::function<void(const RejudgeDone&)>;

class Engine {
 public:
  // Everything but `options` must outlive the engine.
  Engine(EngineOptions options, StoreWriter& disk, ReaderPool& readers, Executor& executor,
         const Clock& clock);

  // See EngineCore::Recover. Call before Run().
  absl::Status Recover() { return core_.Recover(); }

  // Has the loop call `alive` on its thread about every `interval` while it runs, so that a hang is
  // noticed. Call before Run().
  void SetHeartbeat(absl::Duration interval, std::function<void()> alive);

  // Runs the loop until Stop() was called, every runner is dead and every interrupted lease is
  // queued again. An error means that the store or the state is beyond repair; restart the daemon.
  absl::Status Run();
  // Safe to call from a signal handler and from any thread.
  void Stop();

  // Requests. Safe from any thread, answered within `timeout`. Besides EngineCore's errors:
  // CancelledError while stopping, ResourceExhaustedError when the queue is full,
  // DeadlineExceededError. True if the artefact is new. On an error (see Content::AddUpload)
  // nothing was added.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact, const NewUpload& upload,
                                   const UnsubmittedLimits& limits, absl::Duration timeout);
  // If the returned Accepted is linked or repeated, it names an earlier evaluation and nothing new
  // will run. NotFoundError if the artefact's files have been removed. Errors of Submissions::Once.
  absl::StatusOr<Accepted> Submit(const NewSubmission& submission, const AdmissionRules& rules,
                                  const std::string& who, absl::Duration timeout);
  absl::StatusOr<Accepted> Rerun(const NewRerun& rerun, const std::string& who, bool organiser,
                                 const RerunLimits& limits, absl::Duration timeout);
  // Any other store change, on which no running lease depends. `change` owns what it touches.
  // `effect` runs on the loop's thread once the change is written.
  absl::Status Change(StoreChange change, absl::Duration timeout,
                      std::function<absl::Status()> effect = nullptr);
  // The same for a change that returns a value.
  template <typename T>
  absl::StatusOr<T> Change(std::function<absl::StatusOr<T>(Transaction&)> change,
                           absl::Duration timeout,
                           std::function<absl::Status(const T&)> effect = nullptr);
  // For a change that renames or merges teams, or adds members: returns whether there was any.
  absl::StatusOr<bool> ChangeTeams(std::function<absl::StatusOr<bool>(Transaction&)> change,
                                   absl::Duration timeout);
  // See EngineCore::Cancel.
  absl::StatusOr<CancelReport> Cancel(const CancelOrder& order, absl::Duration timeout);

  // What this host grades with: GraderBuild with its adapters and runtimes.
  nlohmann::json HostBuild() const;

  // Rejudges (store/rejudges.h). Errors of PlanRejudge and of the Writer's operations. `sign` runs
  // on the loop's thread, in the act's transaction: its error undoes the whole.
  // `after` (if set) runs on that thread too, once the act is written: also for a caller who did not
  // wait for it, and in the order of the acts. It must own what it touches.
  absl::StatusOr<RejudgePlan> CreateRejudge(const NewRejudge& rejudge, const SignDocument& sign,
                                            const std::string& who, absl::Duration timeout);
  // Applies it, or drops it, which kills its running leases.
  absl::StatusOr<RejudgeDone> EndRejudge(bool apply, const RejudgeAct& act,
                                         const SignDocument& sign, const std::string& who,
                                         absl::Duration timeout, AfterRejudge after = nullptr);
  // For Rejudger: adds items, each as a whole or not at all, and queues those to play. One that is
  // refused is logged.
  absl::Status AddRejudgeItems(std::vector<NewRejudgeItem> items, absl::Duration timeout);

  // Views. Safe from any thread; never wait for a runner or the disk.
  QueueOutlook EstimateOutlook(int64_t evaluation) const {
    return core_.EstimateOutlook(evaluation);
  }
  std::vector<int64_t> QueueOf(const std::set<std::string>* teams) const {
    return core_.QueueOf(teams);
  }
  std::map<int64_t, LiveLease> Running(const std::set<int64_t>* among = nullptr) const {
    return core_.Running(among);
  }
  LiveHealth Health() const { return core_.Health(); }
  Metrics& metrics() const { return core_.metrics(); }
  std::vector<NodeView> Nodes() const { return core_.executor().Nodes(); }

  // Gives a cluster's node no more leases, or some again once it passes its self-test; the store keeps it.
  // Errors of Executor::Drain and Admit, and of Change().
  absl::Status SetNode(const std::string& node, bool drained, const std::string& why,
                       const std::string& who, absl::Duration timeout);

 private:
  void Poll(absl::Duration timeout);
  void Beat();

  absl::StatusOr<Accepted> Admit(std::function<absl::StatusOr<Accepted>(Transaction&)> add,
                                 absl::Duration timeout);

  ReaderPool& readers_;
  const Clock& clock_;
  CommandQueue commands_;
  EngineCore core_;
  std::atomic<bool> stop_ = false;
  absl::Duration beat_interval_ = absl::InfiniteDuration();
  absl::Duration next_beat_ = absl::InfiniteDuration();
  std::function<void()> alive_;
};

template <typename T>
absl::StatusOr<T> Engine::Change(std::function<absl::StatusOr<T>(Transaction&)> change,
                                 absl::Duration timeout,
                                 std::function<absl::Status(const T&)> effect) {
  const auto value = std::make_shared<T>();  // the loop's, if its caller no longer waits
  RETURN_IF_ERROR(Change(
      [change = std::move(change), value](Transaction& writer) -> absl::Status {
        ASSIGN_OR_RETURN(*value, change(writer));
        return absl::OkStatus();
      },
      timeout,
      [effect = std::move(effect), value] {
        return effect == nullptr ? absl::OkStatus() : effect(*value);
      }));
  return *value;
}

}  // namespace myograde::server
