// The heart of the daemon: one thread that runs leases, listens to their
// runners, writes what happened into the store and keeps the timers.
//
// What changes the state by a request (a submission, a cancel) is written first
// and takes effect then, so a store that can't be written refuses it and nothing
// has happened. What happens by itself (an episode, the end of a lease) can't be
// refused: it goes through a journal that is written in order, and is tried again
// every second while the store can't be written; no lease starts meanwhile.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/clock.h"
#include "server/daemon/command_queue.h"
#include "server/daemon/server_config.h"
#include "server/daemon/tracks.h"
#include "server/runner/runner_process.h"
#include "server/scheduler/scheduler.h"
#include "server/store/reader.h"
#include "server/store/store.h"

namespace myograde::server {

struct EngineOptions {
  ServerConfig config;
  std::string data_dir;   // artefacts/ and work/ lie in it
  std::string cache_dir;
  bool slot_uids = false;  // run slot N as uid_base + N (root only)
};

// A running lease, as it was a moment ago.
struct LiveLease {
  int64_t episode = 0;
  int64_t step = 0;
  absl::Duration running;
};

struct LiveHealth {
  int running = 0;
  int64_t pending = 0;
  std::string store_trouble;  // "" while the store can be written
};

class Engine {
 public:
  // `store` and `clock` must outlive it; `readers` is for its own use and others'.
  Engine(EngineOptions options, Store& store, ReaderPool& readers, const Clock& clock);
  ~Engine();

  // Takes up what the store has unfinished: leases that ran go back into the
  // queue, evaluations whose leases have all ended are ended.
  absl::Status Recover();

  // The loop; returns after Stop(), when every runner is dead and every lease
  // that ran is back in the queue. An error: the store or the state is beyond
  // repair; start again.
  absl::Status Run();
  // Safe to call from a signal handler and from any thread.
  void Stop();

  // Requests; safe from any thread, answered within `timeout`. Besides the
  // store's errors: CancelledError while stopping, ResourceExhaustedError
  // when too many wait, DeadlineExceededError.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact, absl::Duration timeout);
  absl::StatusOr<Accepted> Submit(const NewSubmission& submission, const std::string& who,
                                  absl::Duration timeout);
  absl::StatusOr<Accepted> Rerun(const NewRerun& rerun, const std::string& who,
                                 absl::Duration timeout);
  // Ends every unfinished evaluation of the submission; its runners are dead on
  // return. FailedPreconditionError if there is none.
  absl::Status Cancel(int64_t submission, const std::string& why, const std::string& who,
                      absl::Duration timeout);

  // Views for answers; safe from any thread, never wait for a runner or the disk.
  std::optional<QueuePlace> PlaceOf(int64_t evaluation) const;
  std::string WhyWaiting(int64_t evaluation) const;
  std::map<int64_t, LiveLease> Running() const;  // by lease
  LiveHealth Health() const;

 private:
  // What a lease needs to be played; shared by the leases of an evaluation.
  struct Context {
    int64_t evaluation = 0;
    int64_t submission = 0;
    std::string team;
    bool rerun = false;
    std::string artefact;
    std::vector<std::string> command;
    std::vector<std::string> runtimes;  // host folders
    TrackPtr track;
    std::shared_ptr<const std::vector<uint64_t>> seeds;
    std::map<int64_t, std::pair<int64_t, int64_t>> leases;  // id to first and last episode
    std::vector<LeaseRow> open;  // those that had not ended when this was read
  };
  struct LeaseRun {
    std::shared_ptr<const Context> context;
    int64_t lease = 0;
    int64_t attempt = 0;
    int64_t first = 0;
    int64_t last = 0;
    std::string work_dir;
    std::unique_ptr<RunnerProcess> runner;
    std::set<int64_t> recorded;
    std::optional<LeaseEndRecord> end;
    std::string fault;  // set: the grader's, why
  };
  using Change = std::function<absl::Status(Writer&)>;

  // Loop only.
  absl::Status Iterate();
  void Poll(absl::Duration timeout);
  absl::Status Flush();
  void Later(Change change) { journal_.push_back(std::move(change)); }
  absl::Status SettleAll();
  absl::Status Settle(int64_t evaluation);
  void StartLeases();
  void StartLease(const Start& start);
  absl::Status Launch(LeaseRun& running, const Start& start);
  LeaseOrder OrderFor(const LeaseRun& running, const Start& start) const;
  void Listen(LeaseRun& running);
  void OnProgress(LeaseRun& running, const ProgressRecord& record);
  void OnEpisode(LeaseRun& running, const EpisodeFacts& facts);
  void CheckDeadlines();
  void Reap();
  void EndOf(LeaseRun& running);
  void Fault(const LeaseRun& running, const std::string& why);
  void GiveUp(const Verdict& verdict, int64_t lease, const std::string& why);
  absl::Status RunCancel(int64_t submission, const std::string& why, const std::string& who);
  void KillLeases(const std::vector<int64_t>& leases);
  absl::Status Shutdown();
  absl::StatusOr<std::shared_ptr<const Context>> ContextOf(int64_t evaluation);
  absl::StatusOr<TrackPtr> TrackOf(Reader& reader, const std::string& config_hash);
  absl::Status AddEvaluation(int64_t evaluation);
  absl::StatusOr<Accepted> Admit(const std::function<absl::StatusOr<Accepted>(Writer&)>& add);

  const EngineOptions options_;
  Store& store_;
  ReaderPool& readers_;
  const Clock& clock_;
  const std::string owner_;  // "daemon" and its process id, for audit rows
  CommandQueue commands_;
  std::atomic<bool> stop_ = false;

  // Loop only.
  std::deque<Change> journal_;
  absl::Duration flush_after_ = absl::ZeroDuration();
  std::set<int64_t> to_settle_;
  std::map<int64_t, std::shared_ptr<const Context>> contexts_;  // of unfinished evaluations
  std::map<std::string, TrackPtr> tracks_;                      // by config hash
  std::map<int64_t, LeaseRun> running_;                         // by lease

  mutable std::mutex mutex_;
  Scheduler scheduler_;                    // guarded by mutex_
  struct Live {
    int64_t episode;
    int64_t step;
    absl::Duration since;
  };
  std::map<int64_t, Live> live_;           // guarded by mutex_
  std::string store_trouble_;              // guarded by mutex_
};

// The seed of a policy's own randomness in one episode: the last 8 bytes (big
// endian, without their highest bit) of HMAC-SHA256(secret, "ARTEFACT/INDEX").
uint64_t PolicySeed(const std::string& secret, const std::string& artefact, int64_t episode);

}  // namespace myograde::server
