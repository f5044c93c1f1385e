// What the daemon decides and does, without threads and without waiting: RunOnce() does all
// that there is to do at one moment. It runs leases, listens to their runners, writes what
// happened into the store and keeps the deadlines.
//
// What changes the state by a request (a submission, a cancel) is written first and takes
// effect then, so a store that can't be written refuses it and nothing has happened. What
// happens by itself (an episode, the end of a lease) can't be refused: it goes through a
// journal that is written in order, and is tried again every second while the store can't be
// written; no lease starts meanwhile.
//
// An evaluation of which something can't be read, or can't be written though the store can,
// ends as grader_error with the reason, and the others go on. One that can't even be ended is
// told by Health(), and left alone until the next start. Only a broken database file stops the
// engine (store/damage.h).
//
// A lease that is taken back (silent, over its time, wrong records, cancelled) has ended from
// that moment on: what its runner still says is refused. Its slot stays taken until the runner
// is dead, and as long as a process of the slot's sandboxes lives, whichever daemon's they were:
// what can't be killed yet still has memory, disk and maybe a processor.
#pragma once

#include <poll.h>

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
#include "server/config/server_config.h"
#include "server/engine/ports.h"
#include "server/engine/self_test.h"
#include "server/engine/stored.h"
#include "server/grading/tracks.h"
#include "server/runner/lease_report.h"
#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"
#include "server/store/reader.h"
#include "server/store/store.h"

namespace myograde::server {

struct EngineOptions {
  ServerConfig config;
  std::string data_dir;   // artefacts/, work/ and selftest/ lie in it
  std::string cache_dir;
};

// A running lease, as it was a moment ago.
struct LiveLease {
  int64_t evaluation = 0;
  int64_t submission = 0;
  int slot = 0;
  pid_t process = 0;  // the runner's
  int64_t episode = 0;
  int64_t step = 0;
  absl::Duration running;
  absl::Duration silent;   // since the runner's last word
};

struct LiveHealth {
  int running = 0;
  int64_t pending = 0;
  std::map<int, std::string> closed_slots;  // free but for processes that live on, in words
  int ending = 0;             // leases that were taken back and whose runners are not dead yet
  std::string store_trouble;  // "" while the store can be written
  HostHealth::State host = HostHealth::State::kWell;
  std::string host_trouble;   // "" if leases may start
  std::optional<absl::Duration> paused_for;
  std::optional<absl::Duration> next_test;  // from now
  std::map<int64_t, std::string> unreadable;  // evaluations that can't be ended either, and why
};

// What the engine knows of an unfinished evaluation.
struct QueueOutlook {
  std::optional<QueuePlace> place;        // if something of it waits
  std::string waiting;                    // in words, why; "" if nothing waits
  std::string owner;                      // who has to do something about it
  std::optional<absl::Duration> deadline; // from now: when the engine acts, though nothing happens
  std::optional<absl::Duration> end;      // from now: a guess, from how long leases took so far
};

// What a cancel did.
struct CancelReport {
  int killed = 0;          // running leases
  absl::Duration took;     // until the last of their runners was dead
  int still_ending = 0;    // runners that were killed and are not dead yet
};

class EngineCore {
 public:
  using CancelAnswer = std::function<void(absl::StatusOr<CancelReport>)>;

  // All but `options` must outlive it.
  EngineCore(EngineOptions options, Disk& disk, ReaderPool& readers, Processes& processes,
             const Clock& clock);
  ~EngineCore();

  // Takes up what the store has unfinished: leases that ran go back into the
  // queue, evaluations whose leases have all ended are ended.
  absl::Status Recover();

  // All that there is to do now. Returns how long nothing needs to be done unless a runner
  // speaks or a request comes. An error: the store is beyond repair.
  absl::StatusOr<absl::Duration> RunOnce();

  // Adds the descriptors that RunOnce() wants to hear of.
  void AddDescriptors(std::vector<pollfd>& fds) const;

  // No lease starts any more; those that run are put back into the queue, and their runners
  // asked to end. RunOnce() until idle(), or give up: what was written is enough.
  void BeginShutdown();
  bool idle() const { return running_.empty() && ending_.empty() && test_ == nullptr; }
  // The journal, one last time. Kills what still runs.
  absl::Status FinishShutdown();

  // A request's change of the store. RunOnce() writes it; then comes `effect`, if there is one,
  // and then the answer, in any case.
  struct Request {
    StoreChange change;
    std::function<absl::Status()> effect;
    std::function<void(absl::Status)> answer;
  };
  void Ask(Request request) { requests_.push_back(std::move(request)); }
  // An evaluation that is in the store is to be played from now on. While the store can't be
  // read it waits for that. An error: the store is beyond repair.
  absl::Status TakeUp(int64_t evaluation);
  // Ends every evaluation of the submission that the store has as unfinished, at once; answers
  // when its runners are dead, or a second later. FailedPreconditionError if there is none.
  void Cancel(int64_t submission, const std::string& why, const std::string& who,
              CancelAnswer answer);

  // Views; safe from any thread, never wait for a runner or the disk.
  QueueOutlook OutlookOf(int64_t evaluation) const;
  std::map<int64_t, LiveLease> Running() const;  // by lease
  LiveHealth Health() const;

 private:
  // What a lease needs to be played; shared by the leases of an evaluation.
  struct Context {
    int64_t evaluation = 0;
    int64_t submission = 0;
    std::string team;
    std::string party;  // who handed it in; "" for the organiser, who does so for anybody
    Priority priority = Priority::kRanked;
    std::string artefact;
    std::vector<std::string> command;
    std::vector<std::string> runtimes;  // host folders
    std::map<std::string, std::string> environment;
    TrackPtr track;
    SeedsPtr seeds;
    std::map<int64_t, std::pair<int64_t, int64_t>> leases;  // id to first and last episode
    EvaluationRow row;  // as it was taken up
  };
  using ContextPtr = std::shared_ptr<const Context>;
  struct LeaseRun {
    ContextPtr context;
    int64_t lease = 0;
    int64_t attempt = 0;
    int slot = 0;
    int64_t first = 0;
    int64_t last = 0;
    std::string work_dir;
    std::unique_ptr<Runner> runner;
    LeaseReport report;
  };
  // A runner of a lease that was taken back, on its way out.
  struct Ending {
    int64_t lease = 0;
    int64_t attempt = 0;
    int slot = 0;
    std::string work_dir;
    std::unique_ptr<Runner> runner;
    absl::Duration kill_at;
    bool stays = false;  // it was not asked to end
    bool killed = false;
    int64_t late = 0;  // records that came too late
  };
  struct CancelWait {
    std::set<int64_t> leases;
    absl::Duration begin;
    CancelAnswer answer;
  };
  struct Live {
    int64_t evaluation = 0;
    int64_t submission = 0;
    int slot = 0;
    pid_t process = 0;
    int64_t episode = 0;
    int64_t step = 0;
    absl::Duration since;
    absl::Duration heard;
  };

  // What happened and is to be written, of one evaluation.
  struct Entry {
    int64_t evaluation = 0;
    StoreChange change;
  };

  // The journal.
  absl::Status WriteNow(const StoreChange& change);
  void ProbeStore();
  absl::Status Flush();
  absl::Status WriteJournal(Writer& writer) const;
  void AddToJournal(int64_t evaluation, StoreChange change) {
    journal_.push_back({evaluation, std::move(change)});
  }
  absl::Status RequireWritable();
  void WriteRequests();
  void WriteTogether(const std::vector<Request>& requests, std::vector<absl::Status>& statuses);

  // Evaluations.
  struct Loaded {
    ContextPtr context;
    std::vector<LeaseRow> open;  // leases that have not ended
  };
  absl::StatusOr<Loaded> Load(int64_t evaluation);
  absl::Status TakeUpLate();
  ContextPtr ContextOf(const StoredEvaluation& stored) const;
  // Ends it as grader_error, whatever else the engine knows of it.
  void GiveUpUnreadable(int64_t evaluation, const std::string& why);
  std::set<int64_t> Forget(int64_t evaluation);
  absl::Status SettleAll();
  absl::Status Settle(int64_t evaluation);
  void Escalate();

  // Leases.
  void StartLeases();
  void StartLease(const Start& start);
  LeaseOrder OrderFor(const LeaseRun& run) const;
  void Listen(LeaseRun& run);
  void OnProgress(LeaseRun& run, const ProgressRecord& record);
  void OnEpisode(LeaseRun& run, const EpisodeFacts& facts);
  void TakeBackOverdue();
  void SeeEnds();
  void EndOf(LeaseRun& run);
  void Fault(LeaseRun& run, const std::string& why);
  void GiveUp(const Decision& decision, int64_t lease, const std::string& why);
  void FreeSlot(int slot);
  void CloseSlots();
  void SeeClosedSlots();
  // The run leaves running_; its runner is asked to end, or it may stay as long as it needs.
  void TakeBack(int64_t lease, bool ask = true);
  void SeeEnding();
  void AnswerCancels();
  absl::Status CancelEvaluations(int64_t submission, const std::string& why,
                                 const std::string& who, std::set<int64_t>& killed);

  // The host.
  void SeeSelfTest();
  void BeginSelfTest();
  void EndSelfTest(const std::string& fault);

  absl::Duration TimeToNext(absl::Duration now) const;

  const EngineOptions options_;
  Disk& disk_;
  ReaderPool& readers_;
  Processes& processes_;
  const Clock& clock_;
  const std::string owner_;  // "daemon" and its process id, for audit rows

  bool stopping_ = false;
  std::deque<Entry> journal_;
  std::vector<Request> requests_;
  absl::Duration write_after_ = absl::ZeroDuration();
  std::set<int64_t> to_take_up_;
  std::set<int64_t> to_settle_;
  std::map<int64_t, ContextPtr> contexts_;     // of unfinished evaluations
  std::map<int64_t, std::string> given_up_;    // evaluations that can't be read, and why
  StoredContent content_;
  std::map<int64_t, LeaseRun> running_;        // by lease
  std::vector<Ending> ending_;
  std::vector<CancelWait> cancels_;
  absl::Duration next_slot_look_;
  std::unique_ptr<SelfTest> test_;
  TrackPtr suspect_track_;                     // of the last faulty lease

  mutable Mutex mutex_;
  Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  HostHealth host_ ABSL_GUARDED_BY(mutex_);
  std::map<int64_t, Live> live_ ABSL_GUARDED_BY(mutex_);
  int ending_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<int, std::string> closed_slots_ ABSL_GUARDED_BY(mutex_);
  std::string store_trouble_ ABSL_GUARDED_BY(mutex_);
  std::map<int64_t, std::string> unreadable_ ABSL_GUARDED_BY(mutex_);
  // Of those played here; 0: none yet.
  absl::Duration mean_lease_ ABSL_GUARDED_BY(mutex_) = absl::ZeroDuration();
};

}  // namespace myograde::server
