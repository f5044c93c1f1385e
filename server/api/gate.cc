#include "server/api/gate.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

constexpr uint64_t kWakeId = 0;
constexpr uint64_t kFirstListenerId = 1;
constexpr uint64_t kFirstId = 9;
constexpr size_t kReadAtOnce = 64 << 10;
constexpr size_t kDropAtOnce = 256 << 10;
constexpr int kAcceptAtOnce = 64;
constexpr absl::Duration kLookEvery = absl::Milliseconds(200);
// After an accept that failed for want of descriptors or memory.
constexpr absl::Duration kBackOff = absl::Milliseconds(200);
// Answers that a peer has not read yet; more is asked for in vain.
constexpr int64_t kMaxUnsent = int64_t{64} << 20;
// Handshakes that an address may begin at once, as a multiple of those that it may each second.
constexpr double kBurst = 2;

absl::Duration Now() { return SystemClock().Monotonic(); }

const ApiError kStopping = {503, "stopping", "the daemon is about to stop; nothing was changed"};

}  // namespace

Gate::Gate(Options options, WorkQueue& queue)
    : options_(std::move(options)),
      queue_(queue),
      epoll_(::epoll_create1(EPOLL_CLOEXEC)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      arrivals_(options_.limits.address_clients, kBurst * options_.limits.address_clients),
      places_(options_.limits, kFirstId),
      line_(options_.limits.waiting(), options_.limits.peer_waiting()) {}

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
    const MutexLock lock(mutex_);
    returned_.push_back(connection);
    if (returned_.size() > 1) return;  // it is awake already
  }
  Wake();
}

void Gate::Watch(int fd, uint64_t id) {
  epoll_event event = {EPOLLIN, {.u64 = id}};
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event);
}

void Gate::WatchListeners() {
  for (size_t i = 0; i < listeners_.size(); ++i) Watch(listeners_[i].fd, kFirstListenerId + i);
}

void Gate::Run(std::vector<Listener> listeners) {
  listeners_ = std::move(listeners);
  Watch(wake_.get(), kWakeId);
  WatchListeners();
  while (!stop_) {
    const bool sleep = places_.all().empty() && line_.empty() && accepting_;
    std::set<const Listener*> knocked;
    SeeEvents(sleep ? -1 : static_cast<int>(absl::ToInt64Milliseconds(kLookEvery)), knocked);
    TakeReturned();
    if (Now() - looked_at_ >= kLookEvery) {
      LookAtClocks();
      door_.RestoreSpare();
    }
    LetWaitingIn();
    GoOn();
    if (!accepting_ && Now() >= accept_again_) {
      accepting_ = true;
      WatchListeners();
    }
    for (const Listener* listener : knocked) {
      if (accepting_) Accept(*listener);
    }
  }
  HangUpOnAll();
}

void Gate::SeeEvents(int timeout_ms, std::set<const Listener*>& knocked) {
  std::array<epoll_event, 64> events;
  const int n =
      ::epoll_wait(epoll_.get(), events.data(), static_cast<int>(events.size()), timeout_ms);
  for (int i = 0; i < n; ++i) {
    const uint64_t id = events[static_cast<size_t>(i)].data.u64;
    if (id == kWakeId) {
      uint64_t count;
      [[maybe_unused]] const ssize_t got = ::read(wake_.get(), &count, sizeof(count));
    } else if (id < kFirstId) {
      knocked.insert(&listeners_[id - kFirstListenerId]);
    } else if (Connection* connection = places_.Find(id);
               connection != nullptr && !connection->lent) {
      OnReady(*connection);
    }
  }
}

void Gate::HangUpOnAll() {
  line_.SendAway(kStopping);
  std::vector<Connection*> left;
  for (const auto& [id, connection] : places_.all()) {
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
    const MutexLock lock(mutex_);
    returned.swap(returned_);
  }
  for (Connection* connection : returned) {
    connection->lent = false;
    Do(*connection, connection->next);
  }
}

// --- newcomers --------------------------------------------------------------

void Gate::Accept(const Listener& listener) {
  for (int i = 0; i < kAcceptAtOnce; ++i) {
    Newcomer newcomer;
    switch (door_.Accept(listener, newcomer)) {
      case Door::Found::kNewcomer:
        Receive(std::move(newcomer));
        break;
      case Door::Found::kSentAway:
        break;
      case Door::Found::kNobody:
        return;
      case Door::Found::kCantAccept:
        // Those who wait stay readable.
        for (const Listener& each : listeners_) {
          ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, each.fd, nullptr);
        }
        accepting_ = false;
        accept_again_ = Now() + kBackOff;
        return;
    }
  }
}

bool Gate::MakeRoom(const Peer& peer) {
  const bool limited = peer.network && !peer.proxy;
  if (limited && !arrivals_.Allows(peer.key, Now())) return false;
  return places_.MakeRoom(peer);
}

void Gate::Receive(Newcomer newcomer) {
  // Nobody overtakes those of the same peer who came before.
  if (!line_.Has(newcomer.peer) && MakeRoom(newcomer.peer)) {
    return Admit(std::move(newcomer));
  }
  if (draining_) return Tell(newcomer, kStopping);
  line_.Add(std::move(newcomer), Now() + options_.limits.request);
}

void Gate::Admit(Newcomer newcomer) {
  if (newcomer.peer.network) arrivals_.Count(newcomer.peer.key, Now());
  std::unique_ptr<Transport> transport;
  if (newcomer.from != nullptr && newcomer.from->transport_of) {
    transport = newcomer.from->transport_of(newcomer.socket.get());
    if (transport == nullptr) return;
  }
  Connection& connection =
      places_.Add(std::move(newcomer.socket), newcomer.peer, std::move(transport));
  epoll_event event = {EPOLLONESHOT, {.u64 = connection.id}};
  if (::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, connection.fd.get(), &event) != 0) {
    return Close(connection);
  }
  if (!connection.transport->established()) {
    Enter(connection, State::kHandshake);
    return Wait(connection, /*to_send=*/false);
  }
  Enter(connection, State::kIdle);
  OnReady(connection);  // a request is often there already
}

void Gate::LetWaitingIn() {
  if (line_.empty()) return;
  if (draining_) return line_.SendAway(kStopping);
  line_.LetIn([this](const Peer& peer) { return MakeRoom(peer); },
              [this](Newcomer newcomer) { Admit(std::move(newcomer)); });
}

void Gate::GoOn() {
  std::vector<uint64_t> answered;
  answered.swap(answered_);
  for (const uint64_t id : answered) {
    if (Connection* connection = places_.Find(id)) Do(*connection, Next::kRead);
  }
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
                                            : state == State::kHandshake ? limits.handshake()
                                                                         : limits.request);
}

void Gate::Wait(Connection& connection, bool to_send) {
  const uint32_t kinds = EPOLLONESHOT | connection.transport->Wants(to_send);
  epoll_event event = {kinds, {.u64 = connection.id}};
  connection.waiting_since = Now();
  if (::epoll_ctl(epoll_.get(), EPOLL_CTL_MOD, connection.fd.get(), &event) != 0) Close(connection);
}

void Gate::OnReady(Connection& connection) {
  connection.waited += std::max(Now() - connection.waiting_since, absl::ZeroDuration());
  if (connection.state == State::kHandshake) return Lend(connection, WorkKind::kHandshake);
  if (connection.state == State::kAnswering) return Answer(connection);
  if (connection.state == State::kRefused) return DrainOne(connection);
  if (connection.state == State::kStreaming) {
    // Nothing is asked after a stream: what comes is dropped, and who hangs up is gone.
    const bool alive = connection.Read(kReadAtOnce);
    connection.in = std::string();
    return alive ? Wait(connection, /*to_send=*/false) : Close(connection);
  }
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
  if (connection.state == State::kHandshake && next == Next::kRead) {
    Enter(connection, State::kIdle);
    return OnReady(connection);  // a request is often there already
  }
  if (next == Next::kRead && !connection.in.empty() && !connection.body.spooled()) {
    const State before = connection.state;
    next = connection.Feed(options_.rule_of, options_.spool);
    if (before == State::kIdle && connection.state == State::kReceiving) {
      Enter(connection, State::kReceiving);
    }
    if (connection.rule.upload) connection.deadline = connection.since + options_.limits.upload;
    if (connection.unsent() > 0) connection.Send();  // "go on"
  }
  const bool receives = connection.parser.in_body() &&
                        (next == Next::kRead || next == Next::kSpool || next == Next::kServe);
  if (receives && draining_) next = connection.Refuse(kStopping);
  switch (next) {
    case Next::kHandshake:
      return Wait(connection, /*to_send=*/false);
    case Next::kRead:
      if (!CountBody(connection, receives)) return;
      return Wait(connection, /*to_send=*/false);
    case Next::kSend:
      return Answer(connection);
    case Next::kSpool:
      if (!CountBody(connection, true)) return;
      return Lend(connection, WorkKind::kDisk);
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
  const int most = std::max(PlacesFor(connection.peer->peer, options_.limits) / 2, 1);
  if (!receiving || connection.peer->bodies <= most) return true;
  connection.Refuse({429, "too_many",
                     "too many requests of yours arrive at once; let some of them end first"});
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
  queue_.Push({&connection, work, connection.Asker()});
}

void Gate::Answer(Connection& connection) {
  if (connection.state != State::kAnswering) Enter(connection, State::kAnswering);
  if (!connection.Send()) return Close(connection);
  CountUnsent(connection);
  if (connection.unsent() > 0) return Wait(connection, /*to_send=*/true);
  if (connection.file.left > 0) return Lend(connection, WorkKind::kDisk);
  if (connection.stream != nullptr) return Follow(connection);
  if (connection.close_after) return Close(connection);
  connection.Forget();
  Enter(connection, State::kIdle);
  answered_.push_back(connection.id);  // those who wait for its place come first
}

void Gate::Follow(Connection& connection) {
  Enter(connection, State::kStreaming);
  // Among those who may give way to newcomers it has waited since the stream began.
  connection.since = connection.stream->began;
  connection.deadline = connection.stream->until;
  if (Now() >= connection.stream->due) return Lend(connection, WorkKind::kServe);
  Wait(connection, /*to_send=*/false);  // it may hang up
}

// Tells the error and, where the other end may still be sending, reads on so that it gets to hear
// it.
void Gate::Refuse(Connection& connection, bool read_on) {
  if (connection.counted) {
    connection.counted = false;
    --connection.peer->bodies;
  }
  if (options_.on_refusal != nullptr) options_.on_refusal(connection.error.http);
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
    if (connection.unsent() == 0) connection.transport->EndSending();
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

void Gate::Close(Connection& connection) { places_.Remove(connection); }

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
  line_.LookAtClocks(now);
  arrivals_.LookAtClocks(now);
  std::vector<Connection*> over;
  for (const auto& [id, connection] : places_.all()) {
    if (connection->lent) continue;
    const State state = connection->state;
    const bool moves = state != State::kIdle && state != State::kHandshake &&
                       state != State::kStreaming;
    const bool slow = moves && TooSlow(*connection, now);
    const bool stops = draining_ && connection->parser.in_body();
    if (slow || stops || now >= connection->deadline) {
      over.push_back(connection.get());
    } else if (state == State::kStreaming && now >= connection->stream->due) {
      Lend(*connection, WorkKind::kServe);
    }
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
