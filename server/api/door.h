// Where newcomers come in: takes connections off a listener and finds out who they
// are, also when no descriptor is left but a few that are kept for that.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "protocol/base/fd.h"
#include "server/api/api_error.h"
#include "server/api/peer.h"
#include "server/api/transport.h"

namespace myograde::server {

// A socket that connections come in at.
struct Listener {
  int fd = -1;  // must not block
  // Who is at the other end of an accepted socket; nullopt: hang up.
  std::function<std::optional<Peer>(int fd)> peer_of;
  // What its connections speak; empty: bytes as they are. nullptr if there is no memory.
  std::function<std::unique_ptr<Transport>(int fd)> transport_of = {};
};

// Somebody who has no place yet.
struct Newcomer {
  Fd socket;
  Peer peer;
  const Listener* from = nullptr;  // nullptr: one that speaks bytes as they are
};

// Tells a newcomer why not, if it takes that at once. Who speaks TLS is only hung up on: there is
// nothing to say before a handshake.
void Tell(const Newcomer& newcomer, const ApiError& error);

class Door {
 public:
  Door();

  // kNewcomer: `newcomer` came in. kSentAway: somebody came and was told to go. kNobody: nobody
  // waits. kCantAccept: there are no descriptors or no memory, and asking at once again would
  // only burn time.
  enum class Found { kNewcomer, kSentAway, kNobody, kCantAccept };
  // `listener` must outlive the newcomer.
  Found Accept(const Listener& listener, Newcomer& newcomer);
  // Opens the kept descriptors that were given up, as far as there are any again. Accept does so
  // too, as whatever gets free is theirs first.
  void RestoreSpare();

 private:
  Found AcceptWithSpare(const Listener& listener, Newcomer& newcomer);

  std::vector<Fd> spare_;  // descriptors to give up when there are no others
};

}  // namespace myograde::server
