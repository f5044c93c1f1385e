// The daemon's decisions and actions, without threads and without blocking: RunOnce() does
// everything that is due. It runs leases, reads from their runners, records what happened in the
// store and enforces the deadlines.
//
// Changes made by request (a submission, a cancel) are written first and take effect afterwards, so
// a store that can't be written refuses them and nothing has happened. Events (an episode, the end
// of a lease) can't be refused: they go through a journal that is written in order and retried
// every second while the store can't be written; no lease starts meanwhile.
//
// What can't be read or written ends only its own evaluation; only a broken database file stops the
// engine (store/damage.h, server/daemon/README.md).
//
// A reclaimed lease (silent, over its time, wrong records, cancelled) has ended at that moment:
// anything its runner sends later is rejected. Its slot stays taken until the runner is dead and no
// process of the slot's sandboxes lives, even one that another daemon started.
//
// On other hosts (Executor::remote) a slot is a job. A lease begins when its job has a processor; one
// whose node, job or connection was lost, or that is silent, is returned: it is retried, and does not
// count as a fault.
#pragma once

#include <poll.h>

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/base/log_line.h"
#include "server/config/server_config.h"
#include "server/engine/stored.h"
#include "server/executor/executor.h"
#include "server/grading/tracks.h"
#include "server/metrics/metrics.h"
#include "server/runner/lease_report.h"
#include "server/runtime/runtimes.h"
#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"
#include "server/store/store.h"

namespace myograde::server {

// A store change. It owns what it touches, or is outlived by it.
using StoreChange = std::function<absl::Status(Transaction&)>;

// What the core needs from the outside world beside an executor and a Clock: a writable store.
// Tests substitute fakes.
class StoreWriter {
 public:
  virtual ~StoreWriter() = default;

  // See Store::Write.
  virtual absl::Status Write(const StoreChange& change) = 0;
  // See Store::Check.
  virtual absl::Status Check() const { return absl::OkStatus(); }
};

class SqliteStoreWriter : public StoreWriter {
 public:
  // Both must outlive it. `metrics` may be nullptr.
  explicit SqliteStoreWriter(Store& store, Metrics* metrics = nullptr)
      : store_(store), metrics_(metrics) {}
  absl::Status Write(const StoreChange& change) override {
    const absl::Duration begin = SystemClock().Monotonic();
    absl::Status status = store_.Write(change);
    if (metrics_ != nullptr) {
      metrics_->ObserveStoreWrite(SystemClock().Monotonic() - begin, !MayPass(status));
    }
    return status;
  }
  absl::Status Check() const override { return store_.Check(); }

 private:
  Store& store_;
  Metrics* const metrics_;
};

struct EngineOptions {
  ServerConfig config;
  std::string data_dir;   // contains artefacts/, work/ and selftest/
  std::string cache_dir;
  std::shared_ptr<Metrics> metrics = std::make_shared<Metrics>();  // never nullptr
};

// A snapshot of a running lease.
struct LiveLease {
  int64_t evaluation = 0;
  int64_t submission = 0;
  int slot = 0;
  pid_t process = 0;  // the runner's; 0 on another host
  RunnerSite site = {};
  bool begun = true;  // false: it waits there for a processor
  int64_t episode = 0;
  int64_t step = 0;
  absl::Duration running = {};
  absl::Duration silent = {};  // since the runner last wrote
};

// What keeps leases from starting or ending.
struct EngineTroubles {
  std::map<int, std::string> closed_slots;  // slot to the surviving processes' text
  int ending = 0;                // reclaimed leases whose runners are not dead yet
  std::string store_trouble;     // "" while the store is writable
  std::string executor_trouble;  // why nothing can start where leases run; "" if leases can
  std::string disk_trouble;      // why nothing may start; "" while the disk has its reserve
  std::map<int64_t, std::string> unreadable;  // evaluations that can't be ended either, and why
};

struct LiveHealth : EngineTroubles {
  int running = 0;
  int64_t pending = 0;
  HostHealth::State host = HostHealth::State::kWell;
  std::string host_trouble;   // "" if leases may start
  std::string losses;         // leases that were lost one after the other; "" if one has ended since
  std::optional<absl::Duration> paused_for;
  std::optional<absl::Duration> next_test;  // from now
  int64_t journal = 0;        // events that wait to be written
  int busy_slots = 0;         // by leases, those that end, and self-tests; not the closed ones
  QueueDepth queue;
  std::optional<absl::Duration> oldest_run;  // of the lease that runs longest; nullopt: none runs
};

// The engine's view of an unfinished evaluation.
struct QueueOutlook {
  std::optional<QueuePlace> place;        // if any of its leases wait
  std::string waiting;                    // why, for people; "" if nothing waits
  std::string owner;                      // who has to act
  std::optional<absl::Duration> deadline; // from now: when the engine acts even if nothing happens
  std::optional<absl::Duration> end;      // from now: an estimate from recent lease durations
};

// What is to be ended of a submission that is cancelled.
struct CancelOrder {
  int64_t submission = 0;
  bool reruns = false;  // its reruns too, not only its original evaluation
  // Also an evaluation whose first episode has not ended is charged, if a lease of it has begun.
  bool charge = false;
  std::string why;
  std::string who;
};

// The result of a cancel.
struct CancelReport {
  int killed = 0;          // running leases
  absl::Duration took;     // until the last of their runners died
  int still_ending = 0;    // killed runners that are not dead yet
};

class EngineCore {
 public:
  using CancelAnswer = std::function<void(absl::StatusOr<CancelReport>)>;

  // Everything but `options` must outlive it.
  EngineCore(EngineOptions options, StoreWriter& disk, ReaderPool& readers, Executor& executor,
             const Clock& clock);

  // Resumes the store's unfinished work: interrupted leases are queued again, and evaluations whose
  // leases have all ended are settled.
  absl::Status Recover();

  // Does everything that is due. Returns how long nothing needs to be done unless a runner writes
  // or a request arrives. An error: the store is beyond repair.
  absl::StatusOr<absl::Duration> RunOnce();

  // Adds the descriptors that RunOnce() needs polled.
  void AddDescriptors(std::vector<pollfd>& fds) const;

  // Starts no more leases, queues the running ones again and asks their runners to end. Then call
  // RunOnce() until idle(), or give up early: what has been written is enough to recover.
  void BeginShutdown();
  bool idle() const { return running_.empty() && stopping_runners_.empty() && !test_; }
  // Flushes the journal one last time and kills what still runs.
  absl::Status FinishShutdown();

  // A requested store change. RunOnce() writes it, then calls `effect` (if set), and then `answer`
  // in any case.
  struct Request {
    StoreChange change;
    std::function<absl::Status()> effect;
    std::function<void(absl::Status)> answer;
  };
  void Ask(Request request) { requests_.push_back(std::move(request)); }
  // Queues an evaluation that is in the store. While the store can't be read it is deferred. An
  // error: the store is beyond repair.
  absl::Status Enqueue(int64_t evaluation);
  // Stops whatever it has of evaluations that a request has ended in the store.
  void StopEnded(const std::vector<int64_t>& evaluations) {
    for (const int64_t evaluation : evaluations) Forget(evaluation);
  }
  // After teams were renamed or merged: those in the queue follow. What can't be read now keeps its
  // place until the next start.
  void FollowTeams();
  // Ends what is unfinished of the submission at once. Answers when the runners are dead, or after
  // a second. FailedPreconditionError if there is nothing to end.
  void Cancel(const CancelOrder& order, CancelAnswer answer);

  // Views. Safe from any thread; never wait for a runner or the disk.
  QueueOutlook EstimateOutlook(int64_t evaluation) const;
  // See Scheduler::QueueOf.
  std::vector<int64_t> QueueOf(const std::set<std::string>* teams) const;
  // By lease; only of these leases if there is a set, so that its cost doesn't grow with all running
  // ones.
  std::map<int64_t, LiveLease> Running(const std::set<int64_t>* among = nullptr) const;
  LiveHealth Health() const;
  Metrics& metrics() const { return *options_.metrics; }
  Executor& executor() const { return executor_; }
  const EngineOptions& options() const { return options_; }
  const Runtimes& runtimes() const { return runtimes_; }

 private:
  // What playing a lease needs; shared by the leases of an evaluation.
  struct Context : StoredEvaluation {  // as of Enqueue(), but for the blocks
    // Those that it is to be played with, as it began: name and digest ("": not known).
    std::vector<std::pair<std::string, std::string>> runtimes;
    std::map<int64_t, std::pair<int64_t, int64_t>> ranges;  // block to first and last episode
  };
  using ContextPtr = std::shared_ptr<const Context>;
  // A runner with its slot and work folder.
  struct PlacedRunner {
    int64_t lease = 0;  // 0: of a self-test
    int64_t attempt = 0;
    int slot = 0;
    std::string work_dir;
    std::unique_ptr<Runner> runner;  // nullptr: not started (yet)
  };
  struct LeaseRun : PlacedRunner {
    ContextPtr context;
    int64_t first = 0;
    int64_t last = 0;
    LeaseReport report;
    bool begun = true;
    int64_t began_at = 0;  // milliseconds since 1970-01-01 UTC, for people; 0: it has not begun
  };
  // Of a reclaimed lease or an ended self-test, until the runner is dead.
  struct StoppingRunner : PlacedRunner {
    absl::Duration kill_at;
    bool stays = false;  // it was not asked to end
    bool killed = false;
    int64_t late = 0;  // records that arrived too late
  };
  // One episode of a track on this host, with a policy that exits at once, through the same runner,
  // sandboxes, simulator and bridge as any lease. The expected result is known: one record of a
  // crash with the policy's exit status, and a lease that ended well.
  struct SelfTest : PlacedRunner {
    SelfTest() {}  // or Clang takes it for incomplete in std::optional
    absl::Duration deadline;
    LeaseReport report;
    std::optional<EpisodeFacts> facts;
  };
  struct CancelWait {
    std::set<int64_t> leases;
    absl::Duration begin;
    CancelAnswer answer;
  };
  struct Live {
    LiveLease lease;  // but for its times, which follow from these
    absl::Duration since;
    absl::Duration heard;
  };

  // An event of one evaluation that is still to be written.
  struct Entry {
    int64_t evaluation = 0;
    StoreChange change;
  };

  // The journal.
  absl::Status WriteNow(const StoreChange& change);
  // Whether the disk has its reserve.
  bool LookAtDisk();
  absl::Status Flush();
  absl::Status WriteJournal(Transaction& writer) const;
  void ClearJournal();
  void AddToJournal(int64_t evaluation, StoreChange change) {
    journal_.push_back({evaluation, std::move(change)});
    journal_size_ = std::ssize(journal_);
  }
  // Queues an event for webhooks; a failure is only logged, as nothing depends on it.
  void TellLater(const std::string& event, const nlohmann::json& about);
  absl::Status RequireWritable();
  void WatchStore();
  void WriteRequests();
  void WriteTogether(const std::vector<Request>& requests, std::vector<absl::Status>& statuses);

  // Evaluations.
  absl::Status EnqueueDeferred();
  // Ends it as grader_error, whatever else the engine knows about it.
  void GiveUpUnreadable(int64_t evaluation, const std::string& why);
  std::set<int64_t> Forget(int64_t evaluation);
  absl::Status SettleAll();
  absl::Status Settle(int64_t evaluation);
  void Escalate();

  // Leases.
  void StartLeases();
  void StartLease(const Start& start);
  void Preempt();
  // NotFoundError, InternalError: a runtime is no longer there.
  absl::StatusOr<LeaseOrder> OrderFor(const LeaseRun& run) const;
  static LogFields FieldsOf(const LeaseRun& run);
  // Writes that the lease is to be retried.
  void WriteReturn(const LeaseRun& run, bool fault, const std::string& why);
  void Listen(LeaseRun& run);
  // Of leases on other hosts.
  void AttendExecutor();
  absl::Status RecallDrained();
  void FollowSite(LeaseRun& run);
  // `kind`: as Metrics::CountReturn has it.
  void Return(LeaseRun& run, const char* kind, const std::string& why);
  bool MayStart() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Account(const LeaseRun& run, RunEnd how);
  // Accounts for the attempt and reclaims the lease.
  void ReclaimAs(int64_t lease, RunEnd how);
  void OnEpisode(LeaseRun& run, const EpisodeFacts& facts);
  void ReclaimOverdue(absl::Duration now);
  void ReapRunners();
  void OnRunnerEnd(LeaseRun& run);
  // `kind`: as Metrics::CountGraderFault has it.
  // `permanent`: what the lease needs is not on this server, so every attempt would fail, and the
  // host is not to blame.
  void Fault(LeaseRun& run, const char* kind, const std::string& why, bool permanent = false);
  void GiveUp(const Decision& decision, int64_t lease, const std::string& last,
              bool permanent = false);
  void FreeSlot(int slot);
  // Closes those of the slots that processes still live on; false: none.
  bool CloseSlots(int first, int count);
  void ReopenSlots();
  // Moves the lease from running_ to stopping_runners_. Asks its runner to end if `ask`; otherwise
  // the runner may take as long as it needs.
  void Reclaim(int64_t lease, bool ask = true);
  void Stop(PlacedRunner runner, bool ask);
  void ReapStopping();
  void AnswerCancels();
  // Returns the running leases that were killed.
  absl::StatusOr<std::set<int64_t>> CancelEvaluations(const CancelOrder& order);

  // The host.
  void PollSelfTest();
  void BeginSelfTest();
  // nullopt: it still runs. Otherwise "" if the host passed, or what went wrong, in one sentence.
  std::optional<std::string> TestVerdict();
  void EndSelfTest(const std::string& fault);

  absl::Duration TimeToNext(absl::Duration now) const;

  const EngineOptions options_;
  const Runtimes runtimes_{options_.config.runtimes, options_.config.runtimes_dir};
  StoreWriter& disk_;
  ReaderPool& readers_;
  Executor& executor_;
  const Clock& clock_;
  const std::string owner_;  // "daemon" and its process id, for audit rows

  bool stopping_ = false;
  std::deque<Entry> journal_;
  std::atomic<int64_t> journal_size_ = 0;  // the same for other threads
  std::vector<Request> requests_;
  absl::Duration write_after_ = absl::ZeroDuration();
  absl::Duration next_store_check_ = absl::ZeroDuration();
  absl::Duration next_disk_look_ = absl::ZeroDuration();
  std::set<int64_t> deferred_;
  std::set<int64_t> to_settle_;
  std::map<int64_t, ContextPtr> contexts_;     // of unfinished evaluations
  std::map<int64_t, std::string> given_up_;    // evaluations that can't be read, and why
  StoredContent content_;
  std::map<int64_t, LeaseRun> running_;        // by lease
  std::vector<StoppingRunner> stopping_runners_;
  std::vector<CancelWait> cancels_;
  absl::Duration next_slot_check_;
  std::optional<SelfTest> test_;
  TrackPtr suspect_track_;                     // of the last faulty lease

  mutable Mutex mutex_;
  Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  HostHealth host_ ABSL_GUARDED_BY(mutex_);
  std::map<int64_t, Live> live_ ABSL_GUARDED_BY(mutex_);
  EngineTroubles troubles_ ABSL_GUARDED_BY(mutex_);
  int lost_in_a_row_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string last_loss_ ABSL_GUARDED_BY(mutex_);
  // Of leases played here; 0: none yet.
  absl::Duration mean_lease_ ABSL_GUARDED_BY(mutex_) = absl::ZeroDuration();
};

}  // namespace myograde::server
