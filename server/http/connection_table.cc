#include "server/http/connection_table.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace myograde::server {
namespace {

using State = Connection::State;

// The lowest goes first: those that have had an answer and ask for more already, then the ones
// that have asked for nothing or only follow a stream, then those that do not read, then half requests.
int RankOf(const Connection& connection) {
  switch (connection.state()) {
    case State::kIdle:
      return connection.has_input() ? 0 : 1;
    case State::kHandshake:
    case State::kStreaming:
      return 1;
    case State::kRefused:
      return 2;
    case State::kAnswering:
      return 3;
    case State::kReceiving:
      return 4;
  }
  return 4;
}

}  // namespace

int MaxConnections(const Peer& peer, const HttpLimits& limits) {
  if (peer.organiser) return limits.clients;
  // Whom a proxy forwards, it has limits for itself.
  if (peer.proxy) return std::max(limits.clients - limits.organiser_clients, 1);
  return peer.network ? limits.address_clients : limits.peer_clients;
}

std::vector<std::shared_ptr<Connection>> ConnectionTable::all() const {
  std::vector<std::shared_ptr<Connection>> all;
  for (const auto& [id, connection] : connections_) all.push_back(connection);
  return all;
}

bool ConnectionTable::MakeRoom(const Peer& peer) {
  const auto it = peers_.find(peer.key);
  const int own = it == peers_.end() ? 0 : it->second->connections;
  const bool full = static_cast<int>(connections_.size()) >= limits_.clients;
  const bool others_full = others_ >= limits_.clients - limits_.organiser_clients;
  Connection* victim = nullptr;
  if (!peer.organiser && own >= MaxConnections(peer, limits_)) {
    victim = Victim([&](const PeerLoad& other) { return other.peer.key == peer.key; });
  } else if (full || (!peer.organiser && others_full)) {
    // Who has most gives way; organisers only to organisers.
    const auto may_go = [&](const PeerLoad& other) {
      return peer.organiser || !other.peer.organiser;
    };
    int most = 0;
    for (const auto& [key, other] : peers_) {
      if (may_go(*other)) most = std::max(most, other->connections);
    }
    victim = Victim([&](const PeerLoad& other) {
      return other.connections >= most && may_go(other);
    });
  } else {
    return true;
  }
  if (victim == nullptr) return false;
  victim->Close();
  Remove(*victim);
  return true;
}

// Of each rank, who has been so for the longest.
Connection* ConnectionTable::Victim(const std::function<bool(const PeerLoad&)>& among) const {
  Connection* victim = nullptr;
  std::pair<int, absl::Duration> best;
  for (const auto& [id, connection] : connections_) {
    const bool busy = connection->at_work() || connection->receives_body() || connection->is_new();
    if (busy || !among(*connection->peer)) continue;
    const auto place = std::pair(RankOf(*connection), connection->since());
    if (victim == nullptr || place < best) {
      std::tie(victim, best) = std::pair(connection.get(), place);
    }
  }
  return victim;
}

std::shared_ptr<PeerLoad> ConnectionTable::LoadOf(const Peer& peer) {
  std::shared_ptr<PeerLoad>& load = peers_[peer.key];
  if (load == nullptr) load = std::make_shared<PeerLoad>(peer);
  return load;
}

void ConnectionTable::Add(std::shared_ptr<Connection> connection) {
  ++connection->peer->connections;
  if (!connection->peer->peer.organiser) ++others_;
  connections_.emplace(connection->id, std::move(connection));
}

void ConnectionTable::Remove(Connection& connection) {
  const std::shared_ptr<PeerLoad> load = connection.peer;
  if (connections_.erase(connection.id) == 0) return;
  if (!load->peer.organiser) --others_;
  if (--load->connections == 0) peers_.erase(load->peer.key);
}

}  // namespace myograde::server
