// Who may have a connection: the table of those that there are, and those that wait for a place in
// it.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "server/config/server_config.h"
#include "server/http/acceptor.h"
#include "server/http/connection.h"
#include "server/http/peer.h"

namespace myograde::server {

// How many connections `peer` may have.
int MaxConnections(const Peer& peer, const HttpLimits& limits);

// The connections that there are: how many there may be, in all and of each peer, and which one is
// closed for a new one. For one thread.
class ConnectionTable {
 public:
  explicit ConnectionTable(const HttpLimits& limits) : limits_(limits) {}

  bool empty() const { return connections_.empty(); }
  std::vector<std::shared_ptr<Connection>> all() const;

  // Whether `peer` may have one more, for which one that waits for its other end, or is between two
  // requests, may have been closed. False: all that could be closed are busy.
  bool MakeRoom(const Peer& peer);
  // What all connections of `peer` have in common.
  std::shared_ptr<PeerLoad> FindLoad(const Peer& peer);
  void Add(std::shared_ptr<Connection> connection);
  // Nothing if it is no longer there.
  void Remove(Connection& connection);

 private:
  Connection* Victim(const std::function<bool(const PeerLoad&)>& among) const;

  HttpLimits limits_;
  std::map<uint64_t, std::shared_ptr<Connection>> connections_;  // by their ids, oldest first
  std::map<std::string, std::shared_ptr<PeerLoad>> peers_;       // by their keys
  int others_ = 0;  // connections of those who are no organisers
};

// Connections beyond the limits, which wait until one more is allowed, each peer's own in
// the order in which they came. Nothing is read of them meanwhile, so each costs a descriptor and
// little else. For one thread. Times are monotonic.
class WaitingConnections {
 public:
  // At most `most` wait, at most `of_a_peer` of one peer.
  WaitingConnections(int most, int of_a_peer)
      : most_(static_cast<size_t>(most)), of_a_peer_(static_cast<size_t>(of_a_peer)) {}

  bool empty() const { return waiting_ == 0; }
  // Whether somebody of that peer waits already, so that others of it come after.
  bool Has(const Peer& peer) const { return lines_.contains(peer.key); }

  // Rejects it if it is not let in before `until`, or at once if too many wait. If it is the total
  // that is full, the last one of the peer with the most is rejected.
  void Add(AcceptedSocket accepted, absl::Duration until);
  // Lets in whom `make_room` has a place for: organisers first, and peers in turns.
  void LetIn(const std::function<bool(const Peer&)>& make_room,
             const std::function<void(AcceptedSocket)>& let_in);
  // Rejects those whose time is over at `now`, and forgets those who have hung up.
  void LookAtClocks(absl::Duration now);
  // Rejects all.
  void RejectAll(const ApiError& error);

 private:
  struct Waiting {
    AcceptedSocket who;
    absl::Duration until;
  };
  using Line = std::deque<Waiting>;

  std::vector<std::string> KeysInTurn() const;
  // Takes one out, whose line must have somebody in it.
  Waiting TakeFirst(const std::string& key);
  // Rejects the last one of the longest line, if that line is longer than `than`.
  bool RejectLast(size_t than);

  const size_t most_;
  const size_t of_a_peer_;
  std::map<std::string, Line> lines_;  // by the peer's key; none is empty
  size_t waiting_ = 0;                 // in all of them
  std::string last_;                   // whose turn it was
};

}  // namespace myograde::server
