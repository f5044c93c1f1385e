// Whoever is at the other end of connections, as limits count them.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "protocol/base/mutex.h"

namespace myograde::server {

// A user of this host, "uid 1000", or an address of the network, "address 192.0.2.1"; the key is
// all that limits on connections know.
struct Peer {
  std::string key;
  bool organiser = false;  // has places kept free, and limits of its own
  uid_t uid = static_cast<uid_t>(-1);
  bool network = false;    // came over TCP
  bool proxy = false;      // forwards requests of others, and says whose
  bool local = false;      // came over plain HTTP from this host, through no proxy
  std::vector<gid_t> groups = {};  // of a user: as of the first of the present connections
};

// What a peer takes up at the moment, over all of its connections.
struct PeerLoad {
  explicit PeerLoad(Peer who) : peer(std::move(who)) {}

  const Peer peer;
  int connections = 0;              // the gate's own
  int bodies = 0;                   // being received; the gate's own
  std::atomic<int64_t> unsent = 0;  // bytes of answers that wait to be read
  int64_t spooled = 0;              // guarded by SpoolBudget's lock
};

// Bytes of disk for bodies: of those that are being received, with the size that they announce,
// and of those that are worked on. For any thread.
class SpoolBudget {
 public:
  SpoolBudget(int64_t total, int64_t of_a_peer) : total_(total), of_a_peer_(of_a_peer) {}

  enum class Answer { kTaken, kPeerFull, kAllFull };
  Answer Take(PeerLoad& peer, int64_t bytes) {
    const MutexLock lock(mutex_);
    if (bytes > of_a_peer_ - peer.spooled) return Answer::kPeerFull;
    if (bytes > total_ - taken_) return Answer::kAllFull;
    peer.spooled += bytes;
    taken_ += bytes;
    return Answer::kTaken;
  }
  void Give(PeerLoad& peer, int64_t bytes) {
    const MutexLock lock(mutex_);
    peer.spooled -= bytes;
    taken_ -= bytes;
  }

 private:
  const int64_t total_;
  const int64_t of_a_peer_;
  Mutex mutex_;
  int64_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace myograde::server
