#include "server/http/waiting_connections.h"

#include <poll.h>

#include <algorithm>
#include <iterator>
#include <utility>

namespace myograde::server {
namespace {

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
