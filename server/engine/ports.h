// What the engine needs from the outside world beside an executor (server/executor/executor.h): a
// writable store. Time comes from Clock. Tests substitute fakes.
#pragma once

#include <functional>
#include <string>

#include <absl/status/status.h>

#include "protocol/base/clock.h"
#include "server/metrics/metrics.h"
#include "server/store/store.h"

namespace myograde::server {

// A store change. It owns what it touches, or is outlived by it.
using StoreChange = std::function<absl::Status(Transaction&)>;

class Disk {
 public:
  virtual ~Disk() = default;

  // See Store::Write.
  virtual absl::Status Write(const StoreChange& change) = 0;
  // See Store::Check.
  virtual absl::Status Check() const { return absl::OkStatus(); }
};

// The production implementation.
class StoreDisk : public Disk {
 public:
  // Both must outlive it. `metrics` may be nullptr.
  explicit StoreDisk(Store& store, Metrics* metrics = nullptr)
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

}  // namespace myograde::server
