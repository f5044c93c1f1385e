// Writes denied requests and organisers' acts to the store, from a thread of its own: no request and
// no lease waits for it. What can't be written at once is kept, within bounds.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/access/access.h"
#include "server/metrics/metrics.h"
#include "server/store/store.h"

namespace myograde::server {

struct Denial {
  std::string who;     // an Identity's key
  std::string role;
  std::string action;
  std::string why;

  auto operator<=>(const Denial&) const = default;
};

struct CountedDenial {
  Denial denial;
  int64_t count = 0;
};

// Counts denied requests, so that equal ones share a row of the store: whoever makes many of them
// fills neither memory nor disk. For one thread. Times are monotonic.
class DenialCounter {
 public:
  // Between two rows of equal denials.
  static constexpr absl::Duration kEvery = absl::Minutes(1);

  // Beyond `most` different ones in a minute, all others are counted as one, of `OthersKey`.
  // REQUIRES: most > 0.
  explicit DenialCounter(size_t most) : most_(most) {}

  void Add(const Denial& denial);
  // What is to be written at `now`: the first of a kind at once, equal ones a minute later. At an
  // infinite time, all.
  std::vector<CountedDenial> TakeDue(absl::Duration now);
  // Adds what could not be written.
  void Return(const std::vector<CountedDenial>& denials);

  static Denial Others();

 private:
  struct Kind {
    int64_t count = 0;  // not written yet
    absl::Duration written = -absl::InfiniteDuration();
  };

  Kind& KindOf(const Denial& denial);

  const size_t most_;
  std::map<Denial, Kind> kinds_;
};

// Safe from any thread, except for Start and Stop.
class AccessLog {
 public:
  using Change = std::function<absl::Status(Transaction&)>;
  // Applies a change to the store, and waits for it for a bounded time. DeadlineExceededError: it
  // may still happen.
  using Write = std::function<absl::Status(Change)>;

  // `metrics` counts denials; nullptr: nobody does.
  AccessLog(Write write, const Clock& clock, Metrics* metrics = nullptr)
      : write_(std::move(write)), clock_(clock), metrics_(metrics) {}
  AccessLog(const AccessLog&) = delete;
  AccessLog& operator=(const AccessLog&) = delete;

  void Deny(const Identity& who, Action action, const std::string& why);
  void Act(const Identity& who, Action action, const std::string& subject,
           const std::string& detail);
  // A token was used.
  void Touch(int64_t token);

  // Writes now what is due, for whoever is about to copy the store.
  void Flush();

  // Starts the thread.
  void Start();
  // Ends it; what it has not written stays.
  void Stop() { thread_ = {}; }
  // Writes everything now, by `write`. After Stop.
  absl::Status WriteAll(const Write& write);

 private:
  struct Batch {
    std::vector<AccessEventRow> acts;
    std::vector<CountedDenial> denials;
    std::set<int64_t> tokens;
    bool empty() const { return acts.empty() && denials.empty() && tokens.empty(); }
  };

  Batch TakeDue(absl::Duration now);
  static absl::Status WriteBatch(const Write& write, const Batch& batch);

  const Write write_;
  const Clock& clock_;
  Metrics* const metrics_;
  Mutex writing_;  // held from taking a batch until it is written
  Mutex mutex_;
  std::vector<AccessEventRow> acts_ ABSL_GUARDED_BY(mutex_);
  DenialCounter denials_ ABSL_GUARDED_BY(mutex_){100};
  std::set<int64_t> tokens_ ABSL_GUARDED_BY(mutex_);
  std::jthread thread_;
};

}  // namespace myograde::server
