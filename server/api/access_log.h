// Writes denied requests and organisers' acts to the store, from a thread of its own: no request and
// no lease waits for it. What can't be written at once is kept, within bounds.
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <absl/status/status.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/access/access.h"
#include "server/access/denials.h"
#include "server/metrics/metrics.h"
#include "server/store/store.h"

namespace myograde::server {

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
  ~AccessLog() { Stop(); }
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
  void Stop();
  // Writes everything now, by `write`. After Stop.
  absl::Status WriteAll(const Write& write);

 private:
  struct Batch {
    std::vector<AccessEventRow> acts;
    std::vector<CountedDenial> denials;
    std::set<int64_t> tokens;
    bool empty() const { return acts.empty() && denials.empty() && tokens.empty(); }
  };

  void Run();
  Batch TakeDue();
  void Return(Batch batch);
  static absl::Status WriteBatch(const Write& write, const Batch& batch);

  const Write write_;
  const Clock& clock_;
  Metrics* const metrics_;
  Mutex writing_;  // held from taking a batch until it is written
  Mutex mutex_;
  Condition wake_;
  std::vector<AccessEventRow> acts_ ABSL_GUARDED_BY(mutex_);
  DenialCounter denials_ ABSL_GUARDED_BY(mutex_){100};
  std::set<int64_t> tokens_ ABSL_GUARDED_BY(mutex_);
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace myograde::server
