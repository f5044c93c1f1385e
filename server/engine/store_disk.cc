#include "protocol/base/clock.h"
#include "server/engine/ports.h"

namespace myograde::server {

absl::Status StoreDisk::Write(const StoreChange& change) {
  const absl::Duration begin = SystemClock().Monotonic();
  absl::Status status = store_.Write(change);
  if (metrics_ != nullptr) {
    metrics_->ObserveStoreWrite(SystemClock().Monotonic() - begin, !MayPass(status));
  }
  return status;
}

}  // namespace myograde::server
