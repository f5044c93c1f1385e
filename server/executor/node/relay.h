// Sends what a lease's runner prints on its way back: on a thread of its own, as disks and networks
// can hang while the runner must be read and may have to be ended. What can't be sent is kept and
// tried again, further and further apart, until the way back counts as cut.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "protocol/base/mutex.h"
#include "protocol/base/sha256.h"
#include "server/executor/node/channel.h"

namespace myograde::server {

struct RelayLimits {
  size_t most_kept = 64u << 20;                         // bytes of records that wait
  absl::Duration beat = absl::Seconds(1);               // between two looks at the channel
  absl::Duration first_delay = absl::Milliseconds(500); // before a second try; doubles
  absl::Duration longest_delay = absl::Minutes(1);
  absl::Duration cut_after = absl::Minutes(10);         // of failing
};

class Relay {
 public:
  // `channel` must outlive it, and is used by nobody else meanwhile.
  Relay(LeaseChannel& channel, const RelayLimits& limits);
  // Gives up what was not sent. Waits for a call of the channel that runs.
  ~Relay();

  // Both in the order in which they are to arrive.
  void AddLog(std::string name, Fd file);
  void AddRecords(std::string_view lines);

  // OkStatus while all is well or may become so. CancelledError: the daemon wants the end, or the
  // attempt is over. Any other: the way back is cut, and nothing more is sent.
  absl::Status status() const;
  // Readable once status() is no longer OkStatus, or all is sent.
  int wake_fd() const { return wake_.get(); }

  // What follows all records: `end` gets their length and digest. Nothing may be added after it.
  void AddEnd(const NodeEnd& end);
  // The same in place of all that was not sent yet: the records are cut off where they are.
  void EndNow(const NodeEnd& end);
  // After one of these: whether the end has arrived, or can't any more.
  bool over() const;

 private:
  // A log, or records.
  struct Item {
    std::string log;  // "": records
    Fd file;
    std::string records;
  };
  void Run();
  // Waits for the next thing to do. False: there is none any more.
  bool Await();
  // Takes what is to be sent next out of the line, unless it is there already.
  void TakePending();
  absl::Status SendPending();
  absl::Status SendEnd(NodeEnd end);
  void Note(const absl::Status& status, bool ending);
  void Wake() const;
  absl::Duration NextLook() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  LeaseChannel& channel_;
  const RelayLimits limits_;
  Fd wake_;
  mutable Mutex mutex_;
  mutable Condition news_;
  std::deque<Item> items_ ABSL_GUARDED_BY(mutex_);
  size_t kept_ ABSL_GUARDED_BY(mutex_) = 0;  // bytes of records that wait
  std::optional<NodeEnd> end_ ABSL_GUARDED_BY(mutex_);
  bool cut_off_ ABSL_GUARDED_BY(mutex_) = false;  // nothing but the end is sent
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  bool over_ ABSL_GUARDED_BY(mutex_) = false;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Duration last_ ABSL_GUARDED_BY(mutex_);   // use of the channel; monotonic
  absl::Duration delay_ ABSL_GUARDED_BY(mutex_);  // before the next try; 0: the last one succeeded
  // Of the thread alone.
  std::optional<Item> pending_;
  int64_t sent_ = 0;  // bytes of records
  Sha256 hash_;
  std::optional<absl::Duration> failing_since_;
  std::thread thread_;
};

}  // namespace myograde::server
