// Whoever is at the other end of connections, as limits count them.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace myograde::server {

// A user of this host, "uid 1000", or an address of the network, "address 192.0.2.1"; the key is
// all that limits on connections know.
struct Peer {
  std::string key;
  bool organiser = false;  // has connections kept free, and limits of its own
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
  int connections = 0;
  int bodies = 0;       // being received
  int64_t unsent = 0;   // bytes of answers that wait to be read
  int64_t spooled = 0;  // bytes of bodies on the disk, guarded by the spool's lock
};

}  // namespace myograde::server
