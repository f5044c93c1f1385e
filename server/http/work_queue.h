// What the workers have to do, in an order in which nobody can crowd others out:
// peers take turns, each kind of work has a bound of its own, and some workers are
// kept for organisers.
#pragma once

#include <array>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "protocol/base/mutex.h"
#include "server/http/peer.h"

namespace myograde::server {

// kDisk moves what has arrived of a large body to the disk, or reads the next piece of a file that is
// sent; the others answer a whole request.
enum class WorkKind { kServe, kDisk, kSmallUpload, kLargeUpload };
inline constexpr size_t kWorkKinds = 4;

struct Job {
  std::function<void()> run;
  WorkKind work = WorkKind::kServe;
  Peer peer;
};

class WorkQueue {
 public:
  struct Limits {
    int workers = 1;
    int kept = 0;  // workers that only organisers get; less than `workers`
    int of_a_peer = 1;  // workers that one peer gets that is not an organiser
    std::array<int, kWorkKinds> of_a_kind = {1, 1, 1, 1};
  };
  explicit WorkQueue(const Limits& limits) : limits_(limits) {}

  void Push(Job job);
  // Waits for work that may be done now; nullopt once the queue is closed.
  std::optional<Job> Pop();
  // A job that Pop gave is done.
  void Done(const Job& job);
  // Ends every wait; what is left is never given out.
  void Close();
  // Forgets what is left. After Close.
  void Clear();

 private:
  struct Line {
    bool organiser = false;
    int busy = 0;
    std::array<std::deque<Job>, kWorkKinds> jobs;
    bool empty() const;
  };

  // The next job in turn, taken out.
  std::optional<Job> Take() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool MayWork(const Line& line) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Limits limits_;
  Mutex mutex_;
  Condition ready_;
  std::map<std::string, Line> lines_ ABSL_GUARDED_BY(mutex_);  // by the peer's key
  std::string last_ ABSL_GUARDED_BY(mutex_);                   // whose turn it was
  std::array<int, kWorkKinds> busy_ ABSL_GUARDED_BY(mutex_) = {};
  int others_busy_ ABSL_GUARDED_BY(mutex_) = 0;  // with those who are no organisers
  int waiting_ ABSL_GUARDED_BY(mutex_) = 0;      // jobs
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace myograde::server
