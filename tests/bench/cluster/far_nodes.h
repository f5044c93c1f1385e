// Nodes of a cluster that is not there: leases wait in a queue, begin, speak now and then, and end,
// all at times drawn from a seed on a clock that the bench moves.
#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <string>

#include "protocol/base/clock.h"
#include "server/executor/executor.h"

namespace myograde::server {

struct FarNodesOptions {
  int64_t nodes = 10'000;
  uint64_t seed = 1;
  absl::Duration longest_queue = absl::Seconds(10);  // waits are uniform up to this
  absl::Duration lease = absl::Minutes(1);           // runs are within a fifth of this
  absl::Duration speaks = absl::Seconds(5);          // between two progress records
  // Chances of an attempt.
  double dies = 0.005;       // its node is lost: nothing comes any more, and the cluster says so
  double preempted = 0.005;  // the same before it has begun
  double silent = 0.001;     // nothing comes any more, and nobody says so
  double faulty = 0.001;     // its runner reports a fault of the grader
};

struct FarCounts {
  int64_t starts = 0;
  int64_t dies = 0;
  int64_t preempted = 0;
  int64_t silent = 0;
  int64_t faulty = 0;
};

class FarNodes : public Executor {
 public:
  // `clock` must outlive it.
  FarNodes(FarNodesOptions options, const Clock& clock)
      : options_(options), clock_(clock), random_(options.seed) {}

  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                const LeaseSubject& subject) override;
  void CleanUp(const std::string& work_dir) override { (void)work_dir; }
  bool remote() const override { return true; }

  const FarCounts& counts() const { return counts_; }

 private:
  bool Happens(double chance) { return std::uniform_real_distribution<>(0, 1)(random_) < chance; }
  absl::Duration Between(absl::Duration least, absl::Duration most) {
    return least + (most - least) * std::uniform_real_distribution<>(0, 1)(random_);
  }

  const FarNodesOptions options_;
  const Clock& clock_;
  std::mt19937_64 random_;
  FarCounts counts_;
};

}  // namespace myograde::server
