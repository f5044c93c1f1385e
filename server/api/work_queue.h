// What the workers have to do, in an order in which nobody can crowd others out:
// peers take turns, each kind of work has a bound of its own, and some workers are
// kept for organisers.
#pragma once

#include <array>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/api/peer.h"

namespace myograde::server {

class Connection;

// kDisk moves what has arrived of a large body to the disk, or the next piece of a file that is
// sent off it; the others answer a whole request.
enum class WorkKind { kServe, kDisk, kSmallUpload, kLargeUpload };
inline constexpr size_t kWorkKinds = 4;

struct Job {
  Connection* connection = nullptr;
  WorkKind work = WorkKind::kServe;
  Peer peer;
};

class WorkQueue {
 public:
  struct Limits {
    int workers = 1;
    int kept = 0;  // workers that only organisers get; less than `workers`
    int of_a_peer = 1;  // workers that one peer gets that is no organiser
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

 private:
  struct Line {
    bool organiser = false;
    int busy = 0;
    std::array<std::deque<Job>, kWorkKinds> jobs;
    bool empty() const;
  };

  // The next job in turn, taken out. mutex_ is held.
  std::optional<Job> Take();
  bool MayWork(const Line& line) const;

  const Limits limits_;
  std::mutex mutex_;
  std::condition_variable ready_;
  std::map<std::string, Line> lines_;             // by the peer's key
  std::string last_;                              // whose turn it was
  std::array<int, kWorkKinds> busy_ = {};
  int others_busy_ = 0;                           // with those who are no organisers
  int waiting_ = 0;                               // jobs
  bool closed_ = false;
};

}  // namespace myograde::server
