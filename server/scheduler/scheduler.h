// Which lease runs next, where, until when, and what follows from how it ended.
// State and decisions only: no clock, no process, no disk. The caller tells what
// happened and when; the answers say what to start, kill and write down. Time
// is monotonic, as a duration since an arbitrary start.
//
// Turns: a free slot goes to the highest class that has a lease ready (overdue,
// official, practice, re-run), in it to the team that has the fewest running
// leases, of those to the one whose last start is longest ago, of those to the one
// that came first. A team counts as what it has or as what the party has that handed its
// evaluation in, a person with several teams for one, whichever is more: neither several teams of a
// party nor several members of a team get more than one share. Within a team: the older evaluation,
// then the earlier lease. So a team with a thousand submissions delays another team's first lease
// by one lease at most, and whoever waits for longer than `queue_wait` goes ahead of all classes.
//
// A slot is taken from the start of a lease until Free() says that nothing of it runs
// there any more, however long ago the lease was taken back.
#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "server/scheduler/team_line.h"

namespace myograde::server {

struct SchedulerLimits {
  int slots = 1;                                       // leases at once
  int team_running = 1024;                             // of one team
  int max_retries = 3;                                 // after faults of the grader, per lease
  absl::Duration retry_delay = absl::Seconds(2);      // doubled after each further fault
  absl::Duration heartbeat = absl::Seconds(30);        // longest silence of a runner
  absl::Duration queue_wait = absl::Hours(1);          // then it goes ahead of the others
};

struct LeaseSpec {
  int64_t id = 0;
  int64_t attempt = 0;  // starts so far
  int64_t faults = 0;   // the grader's so far
};

struct EvaluationSpec {
  int64_t id = 0;
  std::string team;
  std::string party;              // who handed it in; "": nobody knows, so the team stands for it
  Priority priority = Priority::kRanked;
  absl::Duration lease_wall;      // after this a lease is taken back
  std::vector<LeaseSpec> leases;  // those that have not ended; played in the order of their ids
};

// A lease to start now.
struct Start {
  int64_t evaluation = 0;
  int64_t lease = 0;
  int64_t attempt = 0;
  int slot = 0;
  absl::Duration lease_wall;
};

// A running lease that must be taken back: killed, and told by Faulted().
struct Overdue {
  int64_t lease = 0;
  int64_t attempt = 0;
  std::string why;
};

// What a lease's end means.
struct Decision {
  enum class Kind {
    kStale,            // of an attempt that does not run (any more): to be ignored
    kEvaluationRuns,   // other leases of the evaluation are still to be done
    kEvaluationEnds,   // this was the last one
    kRetry,           // the lease waits to be played again
    kGiveUp,           // too many faults: end the evaluation as grader_error
  };
  Kind kind = Kind::kStale;
  int64_t evaluation = 0;
  // kGiveUp and Cancel(): the other leases of the evaluation; those that run are to be
  // killed, and their slots to be freed.
  std::vector<int64_t> pending = {};
  std::vector<int64_t> running = {};
};

// Where an evaluation stands in the line.
struct QueuePlace {
  int64_t position = 0;      // 1: the next free slot is for it
  int64_t leases_ahead = 0;  // of evaluations that come before it
};

class Scheduler {
 public:
  explicit Scheduler(SchedulerLimits limits);

  // `now` is when its wait begins.
  // REQUIRES: the id is new; there is at least one lease; lease ids are new.
  void Add(const EvaluationSpec& evaluation, absl::Duration now);

  // The next lease to start, already counted as running on its slot; nullopt if
  // no slot is free or nothing may start yet. Call until it says so.
  std::optional<Start> Next(absl::Duration now);

  // The runner of this attempt is alive: the lease is renewed.
  void Heartbeat(int64_t lease, int64_t attempt, absl::Duration now);

  // True while this attempt runs: only then its records count.
  bool IsCurrent(int64_t lease, int64_t attempt) const;

  // The attempt ended with all of its episodes.
  Decision Finished(int64_t lease, int64_t attempt, absl::Duration now);
  // The attempt ended, or is ended now, by a fault of the grader.
  Decision Faulted(int64_t lease, int64_t attempt, absl::Duration now);
  // The evaluation ends now, whatever it does; both lists of the answer name what was open.
  // kStale if it has ended or never was.
  Decision Cancel(int64_t evaluation);

  // Takes a free slot for something else than a lease; nullopt if there is none.
  std::optional<int> TakeSlot();
  // Takes this slot, whatever is there, until Free().
  void Close(int slot) { taken_slots_.insert(slot); }
  // Nothing runs on this slot any more.
  void Free(int slot) { taken_slots_.erase(slot); }

  // Running leases whose runner is silent for too long or which are over their time.
  std::vector<Overdue> OverdueAt(absl::Duration now) const;

  // Evaluations whose wait is over its deadline: they go ahead of all others from now on
  // (again, if they were there), and their next deadline is `queue_wait` later.
  std::vector<int64_t> Escalate(absl::Duration now);

  // When to look again, though nothing happened: the earliest of deadlines and delays.
  std::optional<absl::Duration> NextDeadline(absl::Duration now) const;

  // Views. Their cost grows with the number of teams, not of what waits.
  // nullopt if nothing of the evaluation waits.
  std::optional<QueuePlace> PlaceOf(int64_t evaluation) const;
  int running() const { return static_cast<int>(running_.size()); }
  int64_t pending() const { return static_cast<int64_t>(leases_.size()) - running(); }
  int64_t WaitingLeasesOf(int64_t evaluation) const;
  // Unfinished evaluations of a team that have a lease waiting.
  int64_t WaitingOf(const std::string& team) const;
  const SchedulerLimits& limits() const { return limits_; }
  // In words, why a pending lease does not run; "" if none is pending.
  std::string WhyWaiting(int64_t evaluation, absl::Duration now) const;
  // When the grader does something about the evaluation, though nothing happens: the wait's
  // end, or the first end of a running lease. nullopt if it is not known.
  std::optional<absl::Duration> DeadlineOf(int64_t evaluation) const;

 private:
  struct Lease {
    int64_t id = 0;
    int64_t evaluation = 0;
    int64_t attempt = 0;
    int64_t faults = 0;
    bool running = false;
    int slot = -1;
    absl::Duration not_before = -absl::InfiniteDuration();
    absl::Duration silent_after = absl::InfiniteDuration();
    absl::Duration over_at = absl::InfiniteDuration();
  };
  struct Evaluation {
    EvaluationSpec spec;
    Priority priority = Priority::kRanked;  // now: kOverdue after its wait's deadline
    std::set<int64_t> waiting;
    std::set<int64_t> running;
    absl::Duration wait_over = absl::InfiniteDuration();  // infinite while nothing waits
  };
  struct Share {
    int running = 0;
    int64_t last_start = 0;  // number of the start, 0 before the first
  };
  struct Team : Share {
    TeamLine line;
    int64_t joined = 0;
  };
  // What is compared between teams; the least is next.
  struct Precedence {
    int running;
    int64_t last_start;
    int64_t joined;
    auto operator<=>(const Precedence&) const = default;
  };

  Lease* Current(int64_t lease, int64_t attempt);
  void StopRunning(Lease& lease);
  void Wait(Evaluation& evaluation, absl::Duration until);
  void UpdateLine(Evaluation& evaluation);
  void Remove(int64_t evaluation);
  Share* PartyOf(const Evaluation& evaluation);  // null if nobody knows
  Precedence PrecedenceOf(const Team& team, const Evaluation& evaluation) const;
  Lease* FirstReady(const Team& team, Priority priority, absl::Duration now);
  int FreeSlot() const;

  SchedulerLimits limits_;
  std::map<int64_t, Lease> leases_;
  std::map<int64_t, Evaluation> evaluations_;
  std::map<std::string, Team> teams_;
  std::map<std::string, Share> parties_;
  std::set<int64_t> running_;   // leases
  std::set<int> taken_slots_;
  std::set<std::pair<absl::Duration, int64_t>> delayed_;  // not_before and lease
  std::set<std::pair<absl::Duration, int64_t>> waits_;    // wait_over and evaluation
  int64_t starts_ = 0;
  int64_t joins_ = 0;
};

}  // namespace myograde::server
