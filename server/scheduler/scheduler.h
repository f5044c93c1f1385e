// Which block of episodes runs next, where, until when, and what follows from how it ended. A block
// that runs is a lease: it has a slot, an attempt's number and a deadline. State and decisions
// only: no clock, no process, no disk. The caller reports what happened and when; the answers say
// what to start, kill and record. Times are monotonic, as a duration since an arbitrary start.
//
// Order (server/daemon/README.md says why): a free slot goes to the highest class that has a block
// ready; within it to the team with the fewest running leases; of those to the one whose turn began
// first; of those to the one whose last start is longest ago; of those to the one that came first.
// A turn is an evaluation of the team, from the start of a lease on, for kLongestTurn leases at
// most. A team's count is its own running leases or those of the submitter that submitted its
// evaluation (a person with several teams is one submitter), whichever is more. Within a team: the
// older evaluation, then the earlier block. An evaluation that has waited longer than `queue_wait`
// goes ahead of all classes.
//
// Rejudges are nobody's: they count for no team, wait without a deadline, and give way. While all
// slots are taken and a block of another class is ready, Preempt() names a running lease of theirs to
// reclaim without a fault; it starts again when nothing else is ready.
//
// A slot is taken from the start of a lease until Free() says that nothing of it runs there any
// more, however long ago the lease was reclaimed.
//
// Where leases run on other hosts (`begins_later`), one that has started may wait there for a
// processor: its deadlines count from Begun(). What such a host loses is returned: it is played again
// after a delay and counts as no fault, unless that happens too often.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/scheduler/team_line.h"

namespace myograde::server {

struct SchedulerLimits {
  int slots = 1;                                       // concurrent leases
  int team_running = 1024;                             // concurrent leases of one team
  int max_retries = 3;                                 // after grader faults, per block
  int max_returns = 20;                                // per block; each further one is a fault
  bool begins_later = false;                           // leases run on other hosts
  absl::Duration retry_delay = absl::Seconds(2);      // doubled after each further fault
  absl::Duration heartbeat = absl::Seconds(30);        // longest silence of a runner
  absl::Duration queue_wait = absl::Hours(1);          // after which an evaluation goes ahead of
                                                       // the others
};

struct BlockSpec {
  int64_t id = 0;
  int64_t attempt = 0;  // starts so far
  int64_t faults = 0;   // grader faults so far
};

struct EvaluationSpec {
  int64_t id = 0;
  std::string team;
  std::string submitter;              // who submitted it; "": unknown, so the team stands for it
  Priority priority = Priority::kRanked;
  absl::Duration lease_wall;      // longest run of a lease before it is reclaimed
  std::vector<BlockSpec> blocks;  // that have not ended; played in order of id
};

// A block to start now, or that has started and gives way.
struct Start {
  int64_t evaluation = 0;
  int64_t lease = 0;
  int64_t attempt = 0;
  int slot = 0;
  absl::Duration lease_wall;
};

// A running lease to reclaim: kill it, and report it with Faulted().
struct Overdue {
  int64_t lease = 0;
  int64_t attempt = 0;
  bool silent = false;  // its runner was not heard for too long; else it is over its time
  std::string why;
};

// What follows from a lease's end.
struct Decision {
  enum class Kind {
    kStale,            // the attempt is no longer current: ignore the event
    kEvaluationRuns,   // other blocks of the evaluation are still open
    kEvaluationEnds,   // this was the last one
    kRetry,           // the block is queued for a retry
    kGiveUp,           // too many faults: end the evaluation as grader_error
  };
  Kind kind = Kind::kStale;
  int64_t evaluation = 0;
  bool fault = false;  // the end was counted as a grader fault
  // kGiveUp and Cancel(): the evaluation's other open blocks; kill the running ones and free their
  // slots.
  std::vector<int64_t> pending = {};
  std::vector<int64_t> running = {};
};

// An evaluation's place in the queue.
struct QueuePlace {
  int64_t position = 0;      // 1: gets the next free slot
  int64_t blocks_ahead = 0;  // of evaluations ahead of it
};

// What waits, by class.
struct QueueDepth {
  struct OfClass {
    int64_t evaluations = 0;
    int64_t blocks = 0;
  };
  std::array<OfClass, kPriorities> classes;
  // How long the evaluation that waits longest has had no lease started; nullopt: nothing waits.
  std::optional<absl::Duration> oldest;
};

class Scheduler {
 public:
  explicit Scheduler(SchedulerLimits limits);

  // `now` is when its wait begins. REQUIRES: the id and the block ids are new; there is at least
  // one block.
  void Add(const EvaluationSpec& evaluation, absl::Duration now);

  // The next block to start, already counted as running on its slot; nullopt if no slot is free or
  // nothing may start yet. Call until nullopt.
  std::optional<Start> Next(absl::Duration now);

  // The start of a running lease that must give way now, already counted as waiting; nullopt: none.
  // Its slot stays taken until Free() or Close(). Call until nullopt, after Next().
  std::optional<Start> Preempt(absl::Duration now);

  // The attempt has a processor now: its deadlines begin. Only with `begins_later`.
  void Begun(int64_t lease, int64_t attempt, absl::Duration now);
  // The attempt's runner is alive: extends the lease's heartbeat deadline.
  void Heartbeat(int64_t lease, int64_t attempt, absl::Duration now);

  // The attempt ended with all of its episodes recorded.
  Decision Finished(int64_t lease, int64_t attempt, absl::Duration now);
  // The attempt ended, or is to end now, with a grader fault. `permanent`: each further attempt would
  // end so, too: kGiveUp at once.
  Decision Faulted(int64_t lease, int64_t attempt, absl::Duration now, bool permanent = false);
  // The attempt was lost and nobody is at fault: kRetry after a delay that doubles up to
  // kLongestReturn, or what Faulted() says if this happened more than `max_returns` times.
  Decision Returned(int64_t lease, int64_t attempt, absl::Duration now);
  static constexpr int kLongestTurn = 16;  // leases
  static constexpr absl::Duration kLongestReturn = absl::Minutes(5);
  // Ends the evaluation now, in any state; both lists of the answer name its open blocks. kStale if
  // it has ended or never existed.
  Decision Cancel(int64_t evaluation);

  // The team `from` has a new name, or was merged into the team `to`: from now on they are one.
  void MoveTeam(const std::string& from, const std::string& to);
  // The teams that have or had something to play.
  std::vector<std::string> Teams() const;

  // Takes a free slot for something other than a lease; nullopt if none is free.
  std::optional<int> TakeSlot();
  // Takes this slot until Free(), whatever occupies it.
  void Close(int slot) {
    free_slots_.erase(slot);
    preempting_.erase(slot);
  }
  // Nothing runs on this slot any more.
  void Free(int slot) {
    if (slot < limits_.slots) free_slots_.insert(slot);
    preempting_.erase(slot);
  }

  // Running leases whose runner has been silent for too long or that are over their time. Its cost
  // grows with their number, not with that of all running leases.
  std::vector<Overdue> OverdueAt(absl::Duration now) const;

  // Moves evaluations whose wait is over its deadline ahead of all others and returns them; their
  // next deadline is `queue_wait` later. An evaluation that waits on is returned again then.
  std::vector<int64_t> Escalate(absl::Duration now);

  // When to act again even if nothing happens: the earliest of deadlines and retry delays.
  std::optional<absl::Duration> NextDeadline(absl::Duration now) const;

  // Views. Their cost grows with the number of teams, not of waiting blocks. nullopt if nothing of
  // the evaluation waits.
  std::optional<QueuePlace> PlaceOf(int64_t evaluation) const;
  int running() const { return static_cast<int>(running_.size()); }
  int64_t pending() const { return static_cast<int64_t>(blocks_.size()) - running(); }
  int64_t CountWaitingBlocks(int64_t evaluation) const;
  // Slots that a lease or something else has taken.
  int taken_slots() const { return limits_.slots - static_cast<int>(free_slots_.size()); }
  // Grows with the number of waiting evaluations.
  QueueDepth DepthAt(absl::Duration now) const;
  // Submissions' evaluations (no reruns, no rejudges) of these teams, or with nullptr of all: those that
  // run by id, then those that wait in the order of their places. Grows with their number.
  std::vector<int64_t> QueueOf(const std::set<std::string>* teams) const;
  // Why a pending block does not run, for people; "" if none is pending.
  std::string WhyWaiting(int64_t evaluation, absl::Duration now) const;
  // When the scheduler acts on the evaluation even if nothing happens: the end of its wait, or the
  // first deadline of a running lease. Infinite for a rejudge that waits. nullopt if unknown.
  std::optional<absl::Duration> DeadlineOf(int64_t evaluation) const;

 private:
  struct Block : BlockSpec {
    int64_t evaluation = 0;
    int64_t returns = 0;
    int slot = 0;  // while it runs
    int64_t started = 0;  // sequence number of the last start
    absl::Duration not_before = -absl::InfiniteDuration();
    absl::Duration silent_after = absl::InfiniteDuration();
    absl::Duration over_at = absl::InfiniteDuration();
  };
  struct Evaluation {
    EvaluationSpec spec;
    Priority priority = Priority::kRanked;  // current class: kOverdue once its wait is over
    std::set<int64_t> waiting;
    std::set<int64_t> running;
    absl::Duration wait_over = absl::InfiniteDuration();  // infinite while nothing waits
    absl::Duration waits_since;  // that it was added, or a lease of it started last
  };
  struct Share {
    int running = 0;
    int64_t last_start = 0;  // sequence number of the start, 0 before the first
  };
  struct Turn {
    int64_t of = 0;     // the evaluation whose turn it is
    int64_t began = 0;  // sequence number of the start
    int left = 0;       // leases
  };
  struct Team : Share {
    TeamLine line;
    int64_t joined = 0;  // sequence number of its first evaluation; 0: it has had rejudges only
    Turn turn;
  };
  // The key that teams are compared by; the least goes next.
  struct Precedence {
    int running;
    int64_t turn_began;  // of the turn that goes on; INT64_MAX: another one would begin
    int64_t last_start;
    int64_t joined;
    auto operator<=>(const Precedence&) const = default;
  };

  Block* Current(int64_t lease, int64_t attempt);
  Start StartOf(const Block& block) const {
    return {block.evaluation, block.id, block.attempt, block.slot,
            evaluations_.at(block.evaluation).spec.lease_wall};
  }
  void SetDeadlines(Block& block, absl::Duration silent_after, absl::Duration over_at);
  void WaitAgain(Block& block, absl::Duration delay, absl::Duration now);
  void StopRunning(Block& block);
  void Wait(Evaluation& evaluation, absl::Duration until);
  void Remove(int64_t evaluation);
  Precedence ComputePrecedence(const Team& team, const Evaluation& evaluation) const;
  // Whose shares an evaluation's running leases count in: none for a rejudge.
  std::vector<Share*> SharesOf(const Evaluation& evaluation);
  // Whether `team` may have a block of this class started now.
  bool MayStart(const Team& team, Priority priority) const;
  Block* FirstReady(const Team& team, Priority priority, absl::Duration now);
  // How many blocks above the class of rejudges could start now if there were slots; counts to `most`.
  int ReadyAboveRejudges(int most, absl::Duration now) const;

  SchedulerLimits limits_;
  std::map<int64_t, Block> blocks_;
  std::map<int64_t, Evaluation> evaluations_;
  std::map<std::string, Team> teams_;
  std::map<std::string, Share> parties_;
  std::set<int64_t> running_;   // leases
  std::set<std::pair<int64_t, int64_t>> running_rejudges_;  // sequence number of the start, lease
  std::set<std::pair<absl::Duration, int64_t>> deadlines_;  // of running leases: the next, lease
  std::set<int> free_slots_;
  std::set<int> preempting_;    // slots of leases that gave way, until they are free
  std::set<std::pair<absl::Duration, int64_t>> delayed_;  // not_before and block
  std::set<std::pair<absl::Duration, int64_t>> waits_;    // wait_over and evaluation
  int64_t starts_ = 0;
  int64_t joins_ = 0;
};

}  // namespace myograde::server
