#include "server/api/gate.h"

#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

constexpr uint64_t kWakeId = 0;
constexpr uint64_t kListenerId = 1;
constexpr uint64_t kFirstId = 2;
constexpr size_t kReadAtOnce = 64 << 10;
constexpr size_t kDropAtOnce = 256 << 10;
constexpr int kAcceptAtOnce = 64;
constexpr size_t kSpareDescriptors = 8;
constexpr absl::Duration kLookEvery = absl::Milliseconds(200);
// After an accept that failed for want of descriptors or memory.
constexpr absl::Duration kBackOff = absl::Milliseconds(200);
// Answers that a peer has not read yet; more is asked for in vain.
constexpr int64_t kMaxUnsent = int64_t{64} << 20;

absl::Duration Now() { return SystemClock().Monotonic(); }

void Tell(int socket, const ApiError& error) {
  const std::string text = RefusalBytes(error);
  [[maybe_unused]] const ssize_t n =
      ::send(socket, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

const ApiError kStopping = {503, "stopping", "the daemon is about to stop; nothing was changed"};

}  // namespace

Gate::Gate(Options options, WorkQueue& queue)
    : options_(std::move(options)),
      queue_(queue),
      epoll_(::epoll_create1(EPOLL_CLOEXEC)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      next_id_(kFirstId) {
  RestoreSpare();
}

void Gate::RestoreSpare() {
  while (spare_.size() < kSpareDescriptors) {
    Fd fd(::open("/dev/null", O_RDONLY | O_CLOEXEC));
    if (!fd.valid()) return;
    spare_.push_back(std::move(fd));
  }
}

Gate::~Gate() = default;

void Gate::Wake() {
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(wake_.get(), &one, sizeof(one));
}

void Gate::Drain() {
  draining_ = true;
  Wake();
}

void Gate::Stop() {
  stop_ = true;
  Wake();
}

void Gate::Return(Connection* connection) {
  {
    const std::lock_guard lock(mutex_);
    returned_.push_back(connection);
    if (returned_.size() > 1) return;  // it is awake already
  }
  Wake();
}

void Gate::Run(int listener) {
  const auto watch = [this](int fd, uint64_t id) {
    epoll_event event = {EPOLLIN, {.u64 = id}};
    ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event);
  };
  watch(wake_.get(), kWakeId);
  watch(listener, kListenerId);
  std::array<epoll_event, 64> events;
  while (!stop_) {
    const bool sleep = connections_.empty() && accepting_;
    const int n = ::epoll_wait(epoll_.get(), events.data(), static_cast<int>(events.size()),
                               sleep ? -1 : static_cast<int>(absl::ToInt64Milliseconds(kLookEvery)));
    bool accept = false;
    for (int i = 0; i < n; ++i) {
      const uint64_t id = events[static_cast<size_t>(i)].data.u64;
      if (id == kWakeId) {
        uint64_t count;
        [[maybe_unused]] const ssize_t got = ::read(wake_.get(), &count, sizeof(count));
      } else if (id == kListenerId) {
        accept = true;
      } else if (const auto it = connections_.find(id);
                 it != connections_.end() && !it->second->lent) {
        OnReady(*it->second);
      }
    }
    TakeReturned();
    if (!accepting_ && Now() >= accept_again_) {
      accepting_ = true;
      watch(listener, kListenerId);
    }
    if (accept && accepting_) Accept(listener);
    if (Now() - looked_at_ >= kLookEvery) {
      LookAtClocks();
      RestoreSpare();
    }
  }
  std::vector<Connection*> left;
  for (const auto& [id, connection] : connections_) {
    if (!connection->lent) left.push_back(connection.get());
  }
  for (Connection* connection : left) {
    if (connection->state == State::kReceiving) {
      connection->out += RefusalBytes(kStopping);
      connection->Send();
    }
    Close(*connection);
  }
}

void Gate::TakeReturned() {
  std::vector<Connection*> returned;
  {
    const std::lock_guard lock(mutex_);
    returned.swap(returned_);
  }
  for (Connection* connection : returned) {
    connection->lent = false;
    Do(*connection, connection->next);
  }
}

// --- newcomers --------------------------------------------------------------

void Gate::Accept(int listener) {
  for (int i = 0; i < kAcceptAtOnce; ++i) {
    if (!AcceptOne(listener)) return;
  }
}

bool Gate::AcceptOne(int listener) {
  Fd socket(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  bool spare = false;
  if (!socket.valid()) {
    if (errno == EINTR || errno == ECONNABORTED) return true;
    if (errno == EAGAIN || errno == EWOULDBLOCK) return false;
    const int error = errno;
    // One of the spare descriptors is for an organiser; whoever else it is hears why not.
    spare = (error == EMFILE || error == ENFILE) && !spare_.empty();
    if (spare) {
      spare_.pop_back();
      socket = Fd(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    }
    if (!socket.valid()) {
      if (spare && errno == EAGAIN) return false;
      // Those who wait stay readable, and asking at once again would only burn time.
      spdlog::warn("no connection can be accepted for now: {}",
                   std::generic_category().message(error));
      ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, listener, nullptr);
      accepting_ = false;
      accept_again_ = Now() + kBackOff;
      return false;
    }
  }
  const std::optional<Peer> peer = options_.peer_of(socket.get());
  if (spare && peer.has_value() && !peer->organiser) {
    Tell(socket.get(),
         {503, "too_many", "the server has no descriptors left for you; try again later"});
    socket.reset();
    RestoreSpare();
  } else if (peer.has_value()) {
    Admit(std::move(socket), *peer);
  }
  return true;
}

void Gate::Admit(Fd socket, const Peer& peer) {
  std::shared_ptr<PeerLoad>& load = peers_[peer.key];
  if (load == nullptr) load = std::make_shared<PeerLoad>(peer);
  const std::shared_ptr<PeerLoad> held = load;  // the entry may go with a victim
  if (!MakeRoom(*held)) {
    Tell(socket.get(), {429, "too_many",
                        "all connections that you may have are busy; let one of them end first"});
    if (held->connections == 0) peers_.erase(peer.key);
    return;
  }
  peers_[peer.key] = held;
  const uint64_t id = next_id_++;
  auto made = std::make_unique<Connection>(id, std::move(socket), held);
  Connection& connection = *made;
  epoll_event event = {EPOLLONESHOT, {.u64 = id}};
  if (::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, connection.fd.get(), &event) != 0) return;
  connections_.emplace(id, std::move(made));
  ++held->connections;
  if (!peer.organiser) ++others_;
  Enter(connection, State::kIdle);
  OnReady(connection);  // a request is often there already
}

bool Gate::MakeRoom(const PeerLoad& load) {
  const HttpLimits& limits = options_.limits;
  const auto full = [&] { return static_cast<int>(connections_.size()) >= limits.clients; };
  Connection* victim = nullptr;
  if (!load.peer.organiser && load.connections >= limits.peer_clients) {
    victim = Victim([&](const PeerLoad& other) { return &other == &load; });
  } else if (full() ||
             (!load.peer.organiser && others_ >= limits.clients - limits.organiser_clients)) {
    // Who has most gives way; organisers only to organisers.
    int most = 0;
    for (const auto& [key, other] : peers_) {
      if (load.peer.organiser || !other->peer.organiser) most = std::max(most, other->connections);
    }
    victim = Victim([&](const PeerLoad& other) {
      return other.connections >= most && (load.peer.organiser || !other.peer.organiser);
    });
  } else {
    return true;
  }
  if (victim != nullptr) Close(*victim);
  return victim != nullptr;
}

// Of those that wait for their other end: the ones that have asked for nothing first, then those
// that do not read, then half requests; each time who has been so for the longest.
Connection* Gate::Victim(const std::function<bool(const PeerLoad&)>& among) const {
  Connection* victim = nullptr;
  std::pair<int, absl::Duration> best;
  for (const auto& [id, connection] : connections_) {
    if (connection->lent || connection->counted || !among(*connection->peer)) continue;
    int rank = 0;
    if (connection->state == State::kRefused) rank = 1;
    if (connection->state == State::kAnswering) rank = 2;
    if (connection->state == State::kReceiving) rank = 3;
    const auto place = std::pair(rank, connection->since);
    if (victim == nullptr || place < best) std::tie(victim, best) = std::pair(connection.get(), place);
  }
  return victim;
}

// --- what comes and goes ------------------------------------------------------

void Gate::Enter(Connection& connection, State state) {
  connection.state = state;
  connection.since = Now();
  connection.waited = absl::ZeroDuration();
  connection.moved = 0;
  const HttpLimits& limits = options_.limits;
  connection.deadline = connection.since + (state == State::kIdle        ? limits.idle
                                            : state == State::kAnswering ? limits.upload
                                                                         : limits.request);
}

void Gate::Wait(Connection& connection, bool to_send) {
  const uint32_t kinds = EPOLLONESHOT | (to_send ? EPOLLOUT : EPOLLIN);
  epoll_event event = {kinds, {.u64 = connection.id}};
  connection.waiting_since = Now();
  if (::epoll_ctl(epoll_.get(), EPOLL_CTL_MOD, connection.fd.get(), &event) != 0) Close(connection);
}

void Gate::OnReady(Connection& connection) {
  connection.waited += std::max(Now() - connection.waiting_since, absl::ZeroDuration());
  if (connection.state == State::kAnswering) return Answer(connection);
  if (connection.state == State::kRefused) return DrainOne(connection);
  // A large body goes from the socket to the disk by a worker.
  if (connection.body.spooled() && !connection.lent) return Do(connection, Next::kSpool);
  if (!connection.Read(kReadAtOnce)) {
    if (connection.ended && connection.state == State::kReceiving) {
      connection.error = {400, "bad_request", "the request did not arrive whole; send it again"};
      return Refuse(connection, /*read_on=*/false);
    }
    return Close(connection);
  }
  Do(connection, Next::kRead);
}

void Gate::Do(Connection& connection, Next next) {
  if (next == Next::kRead && !connection.in.empty() && !connection.body.spooled()) {
    const State before = connection.state;
    next = connection.Feed(options_.rule_of, options_.spool);
    if (before == State::kIdle && connection.state == State::kReceiving) {
      Enter(connection, State::kReceiving);
    }
    if (connection.rule.upload) connection.deadline = connection.since + options_.limits.upload;
    if (connection.unsent() > 0) connection.Send();  // "go on"
  }
  const bool receives = connection.reader.has_value() &&
                        (next == Next::kRead || next == Next::kSpool || next == Next::kServe);
  if (receives && draining_) {
    connection.error = kStopping;
    next = Next::kRefuse;
  }
  switch (next) {
    case Next::kRead:
      if (!CountBody(connection, receives)) return;
      return Wait(connection, /*to_send=*/false);
    case Next::kSend:
      return Answer(connection);
    case Next::kSpool:
      if (!CountBody(connection, true)) return;
      return Lend(connection, WorkKind::kSpool);
    case Next::kServe:
      CountBody(connection, false);
      if (connection.peer->unsent > kMaxUnsent) {
        connection.error = {429, "too_many", "read the answers that wait for you first"};
        return Refuse(connection, /*read_on=*/false);
      }
      return Lend(connection, connection.work());
    case Next::kRefuse:
      return Refuse(connection, /*read_on=*/true);
    case Next::kClose:
      return Close(connection);
  }
}

bool Gate::CountBody(Connection& connection, bool receiving) {
  if (receiving == connection.counted) return true;
  connection.counted = receiving;
  connection.peer->bodies += receiving ? 1 : -1;
  const int most = (connection.peer->peer.organiser ? options_.limits.clients
                                                    : options_.limits.peer_clients) / 2;
  if (!receiving || connection.peer->bodies <= most) return true;
  connection.error = {429, "too_many",
                      "too many requests of yours arrive at once; let some of them end first"};
  Refuse(connection, /*read_on=*/true);
  return false;
}

void Gate::CountUnsent(Connection& connection) {
  const auto unsent = static_cast<int64_t>(connection.unsent());
  connection.peer->unsent += unsent - connection.counted_unsent;
  connection.counted_unsent = unsent;
}

void Gate::Lend(Connection& connection, WorkKind work) {
  connection.lent = true;
  queue_.Push({&connection, work, connection.peer->peer});
}

void Gate::Answer(Connection& connection) {
  if (connection.state != State::kAnswering) Enter(connection, State::kAnswering);
  if (!connection.Send()) return Close(connection);
  CountUnsent(connection);
  if (connection.unsent() > 0) return Wait(connection, /*to_send=*/true);
  if (connection.close_after) return Close(connection);
  connection.Forget();
  Enter(connection, State::kIdle);
  Do(connection, Next::kRead);
}

// Tells the error and, where the other end may still be sending, reads on so that it gets to hear
// it.
void Gate::Refuse(Connection& connection, bool read_on) {
  if (connection.counted) {
    connection.counted = false;
    --connection.peer->bodies;
  }
  connection.out += RefusalBytes(connection.error);
  connection.close_after = true;
  const int64_t drain = read_on ? connection.drain_left : 0;
  connection.Forget();
  if (drain - std::ssize(connection.in) <= 0) return Answer(connection);
  connection.drain_left = drain - std::ssize(connection.in);
  connection.in = std::string();
  Enter(connection, State::kRefused);
  DrainOne(connection);
}

void Gate::DrainOne(Connection& connection) {
  if (connection.unsent() > 0) {
    if (!connection.Send()) return Close(connection);
    if (connection.unsent() == 0) ::shutdown(connection.fd.get(), SHUT_WR);
  }
  CountUnsent(connection);
  const bool alive = connection.Read(kDropAtOnce);
  connection.drain_left -= std::ssize(connection.in);
  connection.in = std::string();
  if (!alive || connection.drain_left <= 0) {
    // What was still to be sent is worth one more try, not a wait.
    return Close(connection);
  }
  Wait(connection, /*to_send=*/false);
}

void Gate::Close(Connection& connection) {
  const std::shared_ptr<PeerLoad> load = connection.peer;
  if (connection.counted) --load->bodies;
  if (!load->peer.organiser) --others_;
  connections_.erase(connection.id);
  if (--load->connections == 0) peers_.erase(load->peer.key);
}

// --- clocks -------------------------------------------------------------------

bool Gate::TooSlow(Connection& connection, absl::Duration now) {
  const HttpLimits& limits = options_.limits;
  const absl::Duration waited = connection.waited + (now - connection.waiting_since);
  if (waited < limits.speed_window) return false;
  const double least = static_cast<double>(limits.min_bytes_per_s) * absl::ToDoubleSeconds(waited);
  if (static_cast<double>(connection.moved) < least) return true;
  connection.waited = absl::ZeroDuration();
  connection.waiting_since = now;
  connection.moved = 0;
  return false;
}

void Gate::LookAtClocks() {
  const absl::Duration now = looked_at_ = Now();
  std::vector<Connection*> over;
  for (const auto& [id, connection] : connections_) {
    if (connection->lent) continue;
    const bool slow = connection->state != State::kIdle && TooSlow(*connection, now);
    const bool stops = draining_ && connection->reader.has_value();
    if (slow || stops || now >= connection->deadline) over.push_back(connection.get());
  }
  for (Connection* connection : over) {
    if (connection->state != State::kReceiving) {
      Close(*connection);
      continue;
    }
    connection->error = {408, "too_slow",
                         absl::StrCat("the request took too long to arrive: a connection brings at "
                                      "least ", options_.limits.min_bytes_per_s,
                                      " bytes a second; send it again")};
    if (draining_) connection->error = kStopping;
    Refuse(*connection, /*read_on=*/false);
  }
}

}  // namespace myograde::server
