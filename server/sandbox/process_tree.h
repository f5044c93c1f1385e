// CPU time of a process and all that descend of it, where no control group counts it.
//
// The kernel keeps the time of a process that ended only if its parent waited for it. Of one
// that nobody waits for, as its parent ignores SIGCHLD, the time is lost, and no system call
// of an ordinary user tells it. So the tree is looked at again and again, at moments that
// are drawn by chance, which no process can foresee: who is seen running and is gone at the
// next look ran on for as long as looks lie apart, in the mean. That is an estimate without a
// bias, however short its processes live; it is charged as far as it is more than what was
// waited for, and more than chance explains.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include <absl/time/time.h>

namespace myograde::server {

// Two processes that had the same pid differ in their start.
using ProcessKey = std::pair<pid_t, int64_t>;

struct ProcessSeen {
  int64_t own_ns = 0;
  int64_t children_ns = 0;  // of those that ended and were waited for, less up to two ticks
  double running = 0;       // threads on a processor at that moment
};

// Adds up what looks at a tree show. No clock, no process: tests tell it of others.
class CpuLedger {
 public:
  // Looks by chance lie `apart` from each other in the mean.
  explicit CpuLedger(absl::Duration apart) : apart_(apart), spacing_(apart) {}

  // `seen`: each process was there after the children's times of all were read. `leaving`:
  // those that were there when the look began and were not when their turn came; they are
  // settled at the next look. `by_chance`: nobody could foresee this moment.
  void Look(const std::map<ProcessKey, ProcessSeen>& seen, const std::set<pid_t>& leaving,
            absl::Duration now, bool by_chance);

  int64_t total_ns() const { return total_ns_; }
  // Processes have ended lately, so that it matters which threads run.
  bool churns() const { return looks_since_end_ < kCalmLooks; }
  const std::map<ProcessKey, ProcessSeen>& known() const { return known_; }

 private:
  static constexpr int kCalmLooks = 100;

  const absl::Duration apart_;
  absl::Duration spacing_;  // as it has really been lately
  absl::Duration last_by_chance_ = -absl::InfiniteDuration();
  std::map<ProcessKey, ProcessSeen> known_;
  std::map<ProcessKey, double> run_on_ns_;  // if they are gone at the next look
  int64_t ended_own_ns_ = 0;
  int64_t most_collected_ns_ = 0;
  double missing_ns_ = 0;  // run by the ended, by the estimate, and in no account so far
  double widest_ = 0;      // threads that ran at once lately
  int64_t total_ns_ = 0;
  int looks_since_end_ = kCalmLooks;
};

// The tree below a process of this host.
class ProcessTree {
 public:
  ProcessTree(pid_t root, absl::Duration apart) : root_(root), ledger_(apart) {}

  // Looks at it and returns its CPU time so far in ns, never less than before.
  int64_t CpuNs(bool by_chance);

  // As of the last look.
  std::vector<pid_t> members() const;

 private:
  const pid_t root_;
  CpuLedger ledger_;
};

// True if a thread of one of the processes runs or waits for a processor.
bool AnyRuns(const std::vector<pid_t>& processes);

// The same, or waits in the kernel for what it can't be woken from, as a disk is waited for. A
// process can stay so for as long as it likes (vfork).
bool AnyRunsOrReads(const std::vector<pid_t>& processes);

}  // namespace myograde::server
