// Who is connected: the places that there are, of all and of each peer, and who
// gives one up to a newcomer.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "protocol/base/fd.h"
#include "server/api/connection.h"
#include "server/api/peer.h"
#include "server/config/server_config.h"

namespace myograde::server {

// How many connections `peer` may have.
int PlacesFor(const Peer& peer, const HttpLimits& limits);

// Owns the connections. For one thread.
class Places {
 public:
  using Connections = std::map<uint64_t, std::unique_ptr<Connection>>;

  // Connections are numbered from `first_id` on.
  Places(const HttpLimits& limits, uint64_t first_id) : limits_(limits), next_id_(first_id) {}

  const Connections& all() const { return connections_; }
  // nullptr: it is gone.
  Connection* Find(uint64_t id) const;

  // Whether `peer` may have one place more, for which somebody who waits for its other end, or is
  // between two requests, may have been removed. False: all who could be asked to go are busy.
  bool MakeRoom(const Peer& peer);
  // `transport`: what is spoken over `socket`; nullptr: bytes as they are.
  Connection& Add(Fd socket, const Peer& peer, std::unique_ptr<Transport> transport = nullptr);
  void Remove(Connection& connection);

 private:
  Connection* Victim(const std::function<bool(const PeerLoad&)>& among) const;

  const HttpLimits limits_;
  Connections connections_;
  std::map<std::string, std::shared_ptr<PeerLoad>> peers_;
  uint64_t next_id_;
  int others_ = 0;  // connections of those who are no organisers
};

}  // namespace myograde::server
