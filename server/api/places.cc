#include "server/api/places.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace myograde::server {
namespace {

using State = Connection::State;

// The lowest goes first: those that have had an answer and ask for more already, then the ones
// that have asked for nothing or only follow a stream, then those that do not read, then half requests.
int RankOf(const Connection& connection) {
  switch (connection.state) {
    case State::kIdle:
      return connection.in.empty() ? 1 : 0;
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

int PlacesFor(const Peer& peer, const HttpLimits& limits) {
  if (peer.organiser) return limits.clients;
  // Whom a proxy forwards, it has limits for itself.
  if (peer.proxy) return std::max(limits.clients - limits.organiser_clients, 1);
  return peer.network ? limits.address_clients : limits.peer_clients;
}

Connection* Places::Find(uint64_t id) const {
  const auto it = connections_.find(id);
  return it == connections_.end() ? nullptr : it->second.get();
}

bool Places::MakeRoom(const Peer& peer) {
  const auto it = peers_.find(peer.key);
  const int own = it == peers_.end() ? 0 : it->second->connections;
  const bool full = static_cast<int>(connections_.size()) >= limits_.clients;
  const bool others_full = others_ >= limits_.clients - limits_.organiser_clients;
  Connection* victim = nullptr;
  if (!peer.organiser && own >= PlacesFor(peer, limits_)) {
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
  if (victim != nullptr) Remove(*victim);
  return victim != nullptr;
}

// Of each rank, who has been so for the longest.
Connection* Places::Victim(const std::function<bool(const PeerLoad&)>& among) const {
  Connection* victim = nullptr;
  std::pair<int, absl::Duration> best;
  for (const auto& [id, connection] : connections_) {
    if (connection->lent || connection->counted || !among(*connection->peer)) continue;
    const auto place = std::pair(RankOf(*connection), connection->since);
    if (victim == nullptr || place < best) {
      std::tie(victim, best) = std::pair(connection.get(), place);
    }
  }
  return victim;
}

Connection& Places::Add(Fd socket, const Peer& peer, std::unique_ptr<Transport> transport) {
  std::shared_ptr<PeerLoad>& load = peers_[peer.key];
  if (load == nullptr) load = std::make_shared<PeerLoad>(peer);
  const uint64_t id = next_id_++;
  auto made = std::make_unique<Connection>(id, std::move(socket), load, std::move(transport));
  ++load->connections;
  if (!peer.organiser) ++others_;
  return *connections_.emplace(id, std::move(made)).first->second;
}

void Places::Remove(Connection& connection) {
  const std::shared_ptr<PeerLoad> load = connection.peer;
  if (connection.counted) --load->bodies;
  if (!load->peer.organiser) --others_;
  connections_.erase(connection.id);
  if (--load->connections == 0) peers_.erase(load->peer.key);
}

}  // namespace myograde::server
