// Where newcomers come in: takes connections off a listener and finds out who they
// are, also when no descriptor is left but a few that are kept for that.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "protocol/base/fd.h"
#include "server/api/api_error.h"
#include "server/api/peer.h"

namespace myograde::server {

// Somebody who has no place yet.
struct Newcomer {
  Fd socket;
  Peer peer;
};

// Tells somebody at `socket` why not, if it takes that at once.
void Tell(int socket, const ApiError& error);

class Door {
 public:
  // `peer_of`: who is at the other end of an accepted socket; nullopt: hang up.
  explicit Door(std::function<std::optional<Peer>(int fd)> peer_of);

  // kNewcomer: `newcomer` came in. kSentAway: somebody came and was told to go. kNobody: nobody
  // waits. kCantAccept: there are no descriptors or no memory, and asking at once again would
  // only burn time.
  enum class Found { kNewcomer, kSentAway, kNobody, kCantAccept };
  // `listener` must not block.
  Found Accept(int listener, Newcomer& newcomer);
  // Opens the kept descriptors that were given up, as far as there are any again. Accept does so
  // too, as whatever gets free is theirs first.
  void RestoreSpare();

 private:
  Found AcceptWithSpare(int listener, Newcomer& newcomer);
  const std::function<std::optional<Peer>(int fd)> peer_of_;
  std::vector<Fd> spare_;  // descriptors to give up when there are no others
};

}  // namespace myograde::server
