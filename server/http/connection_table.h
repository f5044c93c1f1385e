// The connections that there are: how many there may be, in all and of each peer, and which one is
// closed for a new one.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/config/server_config.h"
#include "server/http/connection.h"
#include "server/http/peer.h"

namespace myograde::server {

// How many connections `peer` may have.
int MaxConnections(const Peer& peer, const HttpLimits& limits);

// For one thread.
class ConnectionTable {
 public:
  explicit ConnectionTable(const HttpLimits& limits) : limits_(limits) {}

  bool empty() const { return connections_.empty(); }
  std::vector<std::shared_ptr<Connection>> all() const;

  // Whether `peer` may have one more, for which one that waits for its other end, or is between two
  // requests, may have been closed. False: all that could be closed are busy.
  bool MakeRoom(const Peer& peer);
  // What all connections of `peer` have in common.
  std::shared_ptr<PeerLoad> LoadOf(const Peer& peer);
  void Add(std::shared_ptr<Connection> connection);
  // Nothing if it is not there any more.
  void Remove(Connection& connection);

 private:
  Connection* Victim(const std::function<bool(const PeerLoad&)>& among) const;

  HttpLimits limits_;
  std::map<uint64_t, std::shared_ptr<Connection>> connections_;  // by their ids, oldest first
  std::map<std::string, std::shared_ptr<PeerLoad>> peers_;       // by their keys
  int others_ = 0;  // connections of those who are no organisers
};

}  // namespace myograde::server
