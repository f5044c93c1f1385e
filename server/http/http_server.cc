#include "server/http/http_server.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <utility>

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace asio = boost::asio;

constexpr auto kNoThrow = asio::as_tuple(asio::use_awaitable);
constexpr int kSmallUploads = 8;
constexpr int kDiskWorkers = 4;
constexpr int kHandshakeThreads = 2;
constexpr int kAcceptAtOnce = 64;
constexpr std::chrono::milliseconds kClockEvery(200);
// After an accept that failed for want of descriptors or memory.
constexpr std::chrono::milliseconds kBackOff(200);
// Connections that an address may begin at once, as a multiple of those that it may each second.
constexpr double kBurst = 2;
constexpr size_t kMostArrivalKeys = 10'000;  // peers whose arrivals are remembered

absl::Duration Now() { return SystemClock().Monotonic(); }

// What a handler may ask about the request of its own thread.
struct CurrentRequest {
  Connection* connection = nullptr;
  const std::atomic<bool>* stopping = nullptr;
  absl::Duration deadline;
  absl::Duration upload;
};
thread_local CurrentRequest current;

// Small numbers of workers are shared out so that no kind of work is left without one.
WorkQueue::Limits QueueLimits(const HttpLimits& limits) {
  const int half = std::max(limits.workers / 2, 1);
  const int kept = std::min(limits.organiser_workers, half);
  const int others = std::max(limits.workers - kept, 1);
  return {.workers = limits.workers,
          .kept = limits.workers - others,
          .of_a_peer = (others + 1) / 2,
          .of_a_kind = {limits.workers, std::min(kDiskWorkers, half), std::min(kSmallUploads, half),
                        std::min(limits.large_uploads, half)}};
}

}  // namespace

HttpServer::HttpServer(const HttpLimits& limits, std::string spool)
    : limits_(limits),
      spool_(std::move(spool), limits),
      queue_(QueueLimits(limits)),
      handshakes_(kHandshakeThreads),
      arrivals_(limits.address_clients, kBurst * limits.address_clients, kMostArrivalKeys),
      connections_(limits),
      waiting_(limits.waiting(), limits.peer_waiting()),
      io_(std::in_place) {}

absl::Status HttpServer::OpenNetwork(const ListenConfig& config, Fd handed) {
  ASSIGN_OR_RETURN(network_, TcpListener::Open(config, std::move(handed)));
  return absl::OkStatus();
}

absl::Status HttpServer::Start(const std::string& path) {
  ASSIGN_OR_RETURN(Fd listener, ListenAt(path, limits_.socket_mode));
  path_ = path;
  StartOn(std::move(listener));
  return absl::OkStatus();
}

void HttpServer::StartOn(Fd listener) {
  listener_ = std::move(listener);
  const auto peer_of = [this](int fd) {
    std::optional<Peer> peer = UserAt(fd);
    if (peer.has_value() && hooks_.is_organiser(*peer)) peer->organiser = true;
    return peer;
  };
  std::vector<Listener> listeners = {{.fd = listener_.get(), .peer_of = peer_of}};
  if (network_ != nullptr) listeners.push_back(network_->listener());
  StartWith(std::move(listeners));
}

void HttpServer::StartWith(std::vector<Listener> listeners) {
  listeners_ = std::move(listeners);
  for (int i = 0; i < limits_.workers; ++i) {
    workers_.emplace_back([this] {
      while (std::optional<Job> job = queue_.Pop()) {
        job->run();
        queue_.Done(*job);
      }
    });
  }
  for (const Listener& listener : listeners_) {
    asio::co_spawn(*io_, AcceptFrom(listener), asio::detached);
  }
  io_thread_ = std::thread([this] { io_->run(); });
}

void HttpServer::Shutdown() {
  BeginStop();
  queue_.Close();
  if (io_thread_.joinable()) {
    asio::co_spawn(*io_, CloseAll(), asio::detached);
    io_thread_.join();
  }
  // Nobody finds a socket at which nobody answers, however long the handlers take.
  if (!path_.empty()) ::unlink(path_.c_str());
  path_.clear();
  descriptors_.clear();
  listener_.reset();
  network_.reset();
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
  queue_.Clear();
  connections_ = ConnectionTable(limits_);
  handshakes_.join();  // its threads may not have let go yet of what they did for the connections
  io_.reset();
}

// --- new connections --------------------------------------------------------------

asio::awaitable<void> HttpServer::AcceptFrom(const Listener& listener) {
  asio::posix::stream_descriptor& descriptor =
      descriptors_.emplace_back(*io_, ::fcntl(listener.fd, F_DUPFD_CLOEXEC, 0));
  asio::steady_timer timer(*io_);
  for (;;) {
    const auto [error] = co_await descriptor.async_wait(descriptor.wait_read, kNoThrow);
    if (error) co_return;
    Acceptor::Outcome outcome = Acceptor::Outcome::kNone;
    for (int i = 0; i < kAcceptAtOnce; ++i) {
      AcceptedSocket accepted;
      outcome = acceptor_.Accept(listener, accepted);
      if (outcome == Acceptor::Outcome::kAccepted) {
        Receive(std::move(accepted));
      } else if (outcome != Acceptor::Outcome::kRejected) {
        break;
      }
    }
    if (outcome != Acceptor::Outcome::kUnable) continue;
    timer.expires_after(kBackOff);
    co_await timer.async_wait(kNoThrow);
  }
}

void HttpServer::Receive(AcceptedSocket accepted) {
  LetWaitingIn();
  // Nobody overtakes those of the same peer who came before.
  if (!waiting_.Has(accepted.peer) && MakeRoom(accepted.peer)) {
    Admit(std::move(accepted));
  } else if (stopping_) {
    Reject(accepted, kStoppingError);
  } else {
    waiting_.Add(std::move(accepted), Now() + limits_.request);
  }
  if (std::exchange(watching_clocks_, true)) return;
  asio::co_spawn(*io_, WatchClocks(), asio::detached);
}

bool HttpServer::MakeRoom(const Peer& peer) {
  const bool limited = peer.network && !peer.proxy;
  if (limited && arrivals_.Take(peer.key, Now(), /*count=*/false) > absl::ZeroDuration()) {
    return false;
  }
  return connections_.MakeRoom(peer);
}

void HttpServer::Admit(AcceptedSocket accepted) {
  if (accepted.peer.network) arrivals_.Take(accepted.peer.key, Now());
  const bool secure = accepted.from != nullptr && accepted.from->tls_of;
  Connection::Socket socket(*io_);
  boost::system::error_code error;
  socket.assign({accepted.peer.network ? AF_INET : AF_UNIX, 0}, accepted.socket.get(), error);
  if (error) return;
  accepted.socket.release();
  const auto connection = std::make_shared<Connection>(
      ++last_id_, std::move(socket), connections_.FindLoad(accepted.peer),
      secure ? accepted.from->tls_of() : nullptr, *this);
  connections_.Add(connection);
  ++running_;
  asio::co_spawn(*io_, [&connection = *connection] { return connection.Run(); },
                 [this, connection](const std::exception_ptr&) {
                   --running_;
                   connections_.Remove(*connection);
                   LetWaitingIn();
                 });
}

void HttpServer::LetWaitingIn() {
  if (waiting_.empty()) return;
  if (stopping_) return waiting_.RejectAll(kStoppingError);
  waiting_.LetIn([this](const Peer& peer) { return MakeRoom(peer); },
                 [this](AcceptedSocket accepted) { Admit(std::move(accepted)); });
}

asio::awaitable<void> HttpServer::WatchClocks() {
  asio::steady_timer timer(*io_);
  for (;;) {
    const absl::Duration now = Now();
    waiting_.LookAtClocks(now);
    for (const std::shared_ptr<Connection>& connection : connections_.all()) {
      connection->CheckClock(now);
    }
    acceptor_.RestoreSpare();
    LetWaitingIn();
    if (connections_.empty() && waiting_.empty()) break;
    timer.expires_after(kClockEvery);
    co_await timer.async_wait(kNoThrow);
  }
  watching_clocks_ = false;
}

asio::awaitable<void> HttpServer::CloseAll() {
  waiting_.RejectAll(kStoppingError);
  asio::steady_timer timer(*io_);
  for (;;) {
    int busy = 0;
    for (const std::shared_ptr<Connection>& connection : connections_.all()) {
      busy += connection->at_work() ? 1 : 0;
      connection->CloseForStop();
    }
    // Only those that a worker has are left when the thread ends: handshakes use it from others.
    if (running_ <= busy) break;
    timer.expires_after(std::chrono::milliseconds(1));
    co_await timer.async_wait(kNoThrow);
  }
  io_->stop();
}

// --- requests ---------------------------------------------------------------------

BodyRule HttpServer::RuleOf(const Request& head) const {
  const Address* address = router_.Find(head);
  if (address != nullptr && !address->body.types.empty()) return address->body;
  return {.most = limits_.body_bytes, .types = {"application/json"}};
}

void HttpServer::Serve(Connection& connection, Response& response) {
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload};
  connection.head->body = &connection.body;
  try {
    router_.Serve(*connection.head, response);
  } catch (const std::exception& error) {
    spdlog::warn("{} failed: {}", connection.head->path, error.what());
    response.SetError({500, "internal",
                       "the server failed; its log has the reason, for the organisers"});
  }
  current = {};
}

std::optional<std::string> HttpServer::Continue(Connection& connection, const Stream& stream) {
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload};
  std::optional<std::string> more;
  try {
    more = stream.next();
  } catch (const std::exception& error) {
    spdlog::warn("a stream of {} ended: {}", connection.head->path, error.what());
  }
  current = {};
  return more;
}

bool HttpServer::Stopping() { return *current.stopping; }

absl::Duration HttpServer::TimeLeft() {
  if (current.connection == nullptr) return absl::InfiniteDuration();
  return std::max(current.deadline - Now(), absl::ZeroDuration());
}

bool HttpServer::IsOver() {
  if (current.connection == nullptr) return false;
  pollfd entry = {current.connection->fd(), POLLRDHUP, 0};
  const bool gone = ::poll(&entry, 1, 0) > 0 && (entry.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  return gone || *current.stopping || Now() >= current.deadline;
}

void HttpServer::AllowUploadTime() { current.deadline = Now() + current.upload; }

Connection& HttpServer::RequestConnection() { return *current.connection; }

}  // namespace myograde::server
