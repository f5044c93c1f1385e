#include "server/http/connection_table.h"

#include <poll.h>

#include <iterator>
#include <tuple>
#include <utility>

namespace myograde::server {
namespace {

using State = Connection::State;

// The lowest goes first: those that have had an answer and ask for more already, then the ones
// that have asked for nothing or only follow a stream, then those that do not read, then half requests.
int RankOf(const Connection& connection) {
  static const std::map<State, int> kRanks = {{State::kIdle, 1},    {State::kHandshake, 1},
                                              {State::kStreaming, 1}, {State::kRefused, 2},
                                              {State::kAnswering, 3}, {State::kReceiving, 4}};
  const bool asks_for_more = connection.state() == State::kIdle && connection.has_input();
  return asks_for_more ? 0 : kRanks.at(connection.state());
}

const ApiError kAllBusy = {429, "too_many",
                           "all connections that you may have are busy; let one of them end first"};

// Who only sends no more still waits for an answer; but over TCP that is all that is seen of
// somebody who has left.
bool HasHungUp(const AcceptedSocket& accepted) {
  const short left = accepted.peer.network ? POLLRDHUP : short{0};
  pollfd entry = {accepted.socket.get(), left, 0};
  return ::poll(&entry, 1, 0) == 1 && (entry.revents & (POLLHUP | POLLERR | left)) != 0;
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

std::shared_ptr<PeerLoad> ConnectionTable::FindLoad(const Peer& peer) {
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

void WaitingConnections::Add(AcceptedSocket accepted, absl::Duration until) {
  const auto own = lines_.find(accepted.peer.key);
  const size_t length = own == lines_.end() ? 0 : own->second.size();
  if (length >= of_a_peer_ || (waiting_ >= most_ && !RejectLast(length + 1))) {
    return Reject(accepted, kAllBusy);
  }
  lines_[accepted.peer.key].push_back({std::move(accepted), until});
  ++waiting_;
}

bool WaitingConnections::RejectLast(size_t than) {
  const auto longest =
      std::max_element(lines_.begin(), lines_.end(), [](const auto& a, const auto& b) {
        return a.second.size() < b.second.size();
      });
  if (longest == lines_.end() || longest->second.size() <= than) return false;
  Reject(longest->second.back().who, kAllBusy);
  longest->second.pop_back();
  --waiting_;
  return true;
}

std::vector<std::string> WaitingConnections::KeysInTurn() const {
  std::vector<std::string> keys;
  auto it = lines_.upper_bound(last_);
  for (size_t i = 0; i < lines_.size(); ++i, ++it) {
    if (it == lines_.end()) it = lines_.begin();
    keys.push_back(it->first);
  }
  std::stable_partition(keys.begin(), keys.end(), [this](const std::string& key) {
    return lines_.at(key).front().who.peer.organiser;
  });
  return keys;
}

WaitingConnections::Waiting WaitingConnections::TakeFirst(const std::string& key) {
  const auto it = lines_.find(key);
  Waiting first = std::move(it->second.front());
  it->second.pop_front();
  --waiting_;
  if (it->second.empty()) lines_.erase(it);
  last_ = key;
  return first;
}

void WaitingConnections::LetIn(const std::function<bool(const Peer&)>& make_room,
                        const std::function<void(AcceptedSocket)>& let_in) {
  for (bool moved = true; moved && !empty();) {
    moved = false;
    for (const std::string& key : KeysInTurn()) {
      // Nobody gives a place up to somebody who has left.
      while (lines_.contains(key) && HasHungUp(lines_.at(key).front().who)) {
        TakeFirst(key);
      }
      if (!lines_.contains(key) || !make_room(lines_.at(key).front().who.peer)) continue;
      let_in(TakeFirst(key).who);
      moved = true;
    }
  }
}

void WaitingConnections::LookAtClocks(absl::Duration now) {
  for (auto it = lines_.begin(); it != lines_.end();) {
    Line& line = it->second;
    waiting_ -= line.size();
    std::erase_if(line, [&](const Waiting& one) {
      if (now >= one.until) Reject(one.who, kAllBusy);
      return now >= one.until || HasHungUp(one.who);
    });
    waiting_ += line.size();
    it = line.empty() ? lines_.erase(it) : std::next(it);
  }
}

void WaitingConnections::RejectAll(const ApiError& error) {
  for (const auto& [key, line] : lines_) {
    for (const Waiting& one : line) Reject(one.who, error);
  }
  lines_.clear();
  waiting_ = 0;
}

}  // namespace myograde::server
