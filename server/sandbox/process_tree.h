// CPU time of a process and all its descendants, where no control group counts it.
//
// The kernel keeps an ended process' time only if its parent waited for it. If nobody waits, as
// when the parent ignores SIGCHLD, the time is lost, and no system call of an ordinary user tells
// it. So the tree is sampled at random moments, which no process can foresee: a process seen
// running and gone at the next sample is taken to have run on for the mean interval between
// samples. That estimate is unbiased, however short-lived the processes; it is charged as far as it
// exceeds what was waited for and what chance explains.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/time/time.h>

namespace myograde::server {

// Start time distinguishes processes that reuse a pid.
using ProcessKey = std::pair<pid_t, int64_t>;

struct ProcessSeen {
  int64_t own_ns = 0;
  int64_t children_ns = 0;  // of ended children that were waited for, less up to two ticks
  double running = 0;       // threads on a processor at that moment
};

// Adds up samples of a process tree. No clock, no processes: tests feed it made-up ones.
class CpuLedger {
 public:
  // Random samples are `apart` on average.
  explicit CpuLedger(absl::Duration apart) : apart_(apart), spacing_(apart) {}

  // `seen`: each process was alive after all children's times had been read. `leaving`: alive when
  // the sample began, but gone when their turn came; settled at the next sample. `by_chance`:
  // nobody could foresee this moment.
  void AddSample(const std::map<ProcessKey, ProcessSeen>& seen, const std::set<pid_t>& leaving,
                 absl::Duration now, bool by_chance);

  int64_t total_ns() const { return total_ns_; }
  // Processes have ended recently, so that it matters which threads run.
  bool churns() const { return samples_since_end_ < kCalmSamples; }
  const std::map<ProcessKey, ProcessSeen>& known() const { return known_; }

 private:
  static constexpr int kCalmSamples = 100;

  const absl::Duration apart_;
  absl::Duration spacing_;  // as observed recently
  absl::Duration last_by_chance_ = -absl::InfiniteDuration();
  std::map<ProcessKey, ProcessSeen> known_;
  std::map<ProcessKey, double> run_on_ns_;  // charged if they are gone at the next sample
  int64_t ended_own_ns_ = 0;
  int64_t most_collected_ns_ = 0;
  double missing_ns_ = 0;  // estimated time of ended processes that no account includes yet
  double widest_ = 0;      // recent number of simultaneous threads
  int64_t total_ns_ = 0;
  int samples_since_end_ = kCalmSamples;
};

// The tree below a process of this host.
class ProcessTree {
 public:
  ProcessTree(pid_t root, absl::Duration apart) : root_(root), ledger_(apart) {}

  // Samples the tree and returns its CPU time so far in ns, never less than before.
  int64_t CpuNs(bool by_chance);

  // As of the last sample.
  std::vector<pid_t> members() const;

 private:
  const pid_t root_;
  CpuLedger ledger_;
};

// The numeric names in a folder of /proc, such as the processes of this host. Cheap.
std::vector<pid_t> NumbersIn(const std::string& folder);

// True if any thread of the processes is in one of these states of proc(5): R, it runs or waits for
// a processor; D, it waits uninterruptibly in the kernel, as for a disk. A process can stay in that
// state for as long as it likes (vfork).
bool AnyThreadIs(std::string_view states, const std::vector<pid_t>& processes);

}  // namespace myograde::server
