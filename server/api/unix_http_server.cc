#include "server/api/unix_http_server.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <optional>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"

namespace myograde::server {
namespace {

constexpr int kBacklog = 1024;
constexpr int kSmallUploads = 8;
constexpr int kDiskWorkers = 4;
constexpr int kHandshakeWorkers = 4;

absl::Duration Now() { return SystemClock().Monotonic(); }

// What a handler may ask about the request of its own thread.
struct CurrentRequest {
  Connection* connection = nullptr;
  const std::atomic<bool>* stopping = nullptr;
  absl::Duration deadline;
  absl::Duration upload;
};
thread_local CurrentRequest current;

// The groups of the user at the other end, but for the main one.
std::vector<gid_t> GroupsOf(int fd) {
  std::vector<gid_t> groups(64);
  for (;;) {
    auto size = static_cast<socklen_t>(groups.size() * sizeof(gid_t));
    const int failed = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &size);
    if (failed != 0 && errno == ERANGE && size > groups.size() * sizeof(gid_t)) {
      groups.resize(size / sizeof(gid_t));
      continue;
    }
    groups.resize(failed == 0 ? size / sizeof(gid_t) : 0);
    return groups;
  }
}

// Small numbers of workers are shared out so that no kind of work is left without one.
WorkQueue::Limits QueueLimits(const HttpLimits& limits) {
  const int half = std::max(limits.workers / 2, 1);
  const int kept = std::min(limits.organiser_workers, half);
  const int others = std::max(limits.workers - kept, 1);
  return {.workers = limits.workers,
          .kept = limits.workers - others,
          .of_a_peer = (others + 1) / 2,
          .of_a_kind = {limits.workers, std::min(kDiskWorkers, half), std::min(kSmallUploads, half),
                        std::min(limits.large_uploads, half), std::min(kHandshakeWorkers, half)}};
}

absl::Status Failed(const std::string& path, const char* what) {
  return absl::ErrnoToStatus(errno, absl::StrCat(path, ": the socket can't be ", what));
}

absl::StatusOr<sockaddr_un> AddressOf(const std::string& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": is too long for a socket's path (", sizeof(address.sun_path) - 1,
                     " bytes); choose another with --socket"));
  }
  std::memcpy(address.sun_path, path.data(), path.size());
  return address;
}

// A socket file that a dead daemon left is removed; anything else is not ours.
absl::Status MakeRoom(const std::string& path, const sockaddr_un& address) {
  struct stat info;
  if (lstat(path.c_str(), &info) != 0) return absl::OkStatus();
  if (!S_ISSOCK(info.st_mode)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, ": is there and no socket; move it away or choose another --socket"));
  }
  const Fd probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0 ||
      errno == EAGAIN) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, ": another program listens there; stop it or choose another --socket"));
  }
  if (unlink(path.c_str()) != 0) return Failed(path, "replaced");
  return absl::OkStatus();
}

}  // namespace

UnixHttpServer::UnixHttpServer(const HttpLimits& limits, std::string spool)
    : limits_(limits),
      spool_(std::move(spool)),
      budget_(limits.spool_bytes, limits.peer_spool_bytes),
      queue_(QueueLimits(limits)),
      gate_({.limits = limits,
             .spool = {spool_, limits.disk_reserve, &budget_},
             .rule_of = [this](const Request& head) { return RuleOf(head); },
             .on_refusal =
                 [this](int http) {
                   if (count_refusal_ != nullptr) count_refusal_(http);
                 }},
            queue_) {}

UnixHttpServer::~UnixHttpServer() { Shutdown(); }

bool UnixHttpServer::Stopping() { return *current.stopping; }

absl::Duration UnixHttpServer::TimeLeft() {
  if (current.connection == nullptr) return absl::InfiniteDuration();
  return std::max(current.deadline - Now(), absl::ZeroDuration());
}

bool UnixHttpServer::IsOver() {
  if (current.connection == nullptr) return false;
  pollfd entry = {current.connection->fd.get(), POLLRDHUP, 0};
  const bool gone = ::poll(&entry, 1, 0) > 0 && (entry.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  return gone || *current.stopping || Now() >= current.deadline;
}

void UnixHttpServer::AllowUploadTime() { current.deadline = Now() + current.upload; }

Connection& UnixHttpServer::RequestConnection() { return *current.connection; }

// Who is at the other end, as the kernel knows it.
std::optional<Peer> UnixHttpServer::PeerOf(int fd) const {
  ucred user = {};
  socklen_t size = sizeof(user);
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &user, &size) != 0) return std::nullopt;
  const std::string key = PeerKey(user.uid);
  Peer peer{
      .key = key, .organiser = IsOrganiser(key), .uid = user.uid, .groups = GroupsOf(fd)};
  peer.groups.push_back(user.gid);
  if (is_organiser_ != nullptr && is_organiser_(peer)) peer.organiser = true;
  return peer;
}

BodyRule UnixHttpServer::RuleOf(const Request& head) const {
  const Address* address = router_.Find(head);
  if (address != nullptr && !address->body.types.empty()) return address->body;
  return {.most = limits_.body_bytes, .types = {"application/json"}};
}

absl::Status UnixHttpServer::Bind(const std::string& path) {
  ASSIGN_OR_RETURN(sockaddr_un address, AddressOf(path));
  RETURN_IF_ERROR(MakeRoom(path, address));
  listener_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!listener_.valid()) return Failed(path, "made");
  // Born with no rights for others; they come before anybody can connect. The kernel takes the
  // socket's own mode for its file; the mask would be the whole process', whose other threads make
  // files at this moment.
  if (fchmod(listener_.get(), 0600) != 0) return Failed(path, "given its rights");
  if (bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Failed(path, "bound; check the folder's rights");
  }
  path_ = path;
  if (chmod(path.c_str(), limits_.socket_mode) != 0) return Failed(path, "given its rights");
  if (::listen(listener_.get(), kBacklog) != 0) return Failed(path, "listened on");
  return absl::OkStatus();
}

absl::Status UnixHttpServer::OpenNetwork(const ListenConfig& config, Fd handed) {
  ASSIGN_OR_RETURN(network_, NetworkDoor::Open(config, std::move(handed)));
  return absl::OkStatus();
}

void UnixHttpServer::ReloadCertificate() {
  if (network_ != nullptr) network_->Reload();
}

absl::Status UnixHttpServer::Start(const std::string& path) {
  RETURN_IF_ERROR(Bind(path));
  Begin();
  return absl::OkStatus();
}

void UnixHttpServer::StartOn(Fd listener) {
  listener_ = std::move(listener);
  Begin();
}

void UnixHttpServer::Begin() {
  for (int i = 0; i < limits_.workers; ++i) workers_.emplace_back([this] { Work(); });
  std::vector<Listener> listeners = {
      {.fd = listener_.get(), .peer_of = [this](int fd) { return PeerOf(fd); }}};
  if (network_ != nullptr) listeners.push_back(network_->listener());
  acceptor_ = std::thread(
      [this, listeners = std::move(listeners)]() mutable { gate_.Run(std::move(listeners)); });
}

void UnixHttpServer::Work() {
  while (std::optional<Job> job = queue_.Pop()) {
    Connection& connection = *job->connection;
    if (job->work == WorkKind::kDisk || job->work == WorkKind::kHandshake) {
      connection.next =
          connection.Work(job->work, {spool_, limits_.disk_reserve, &budget_, admit_});
    } else if (connection.state == Connection::State::kStreaming) {
      Continue(connection);
    } else {
      Serve(connection);
    }
    queue_.Done(*job);
    gate_.Return(&connection);
  }
}

void UnixHttpServer::Serve(Connection& connection) {
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload};
  connection.head->body = &connection.body;
  Response response;
  try {
    router_.Serve(*connection.head, response);
  } catch (const std::exception& error) {
    spdlog::warn("{} failed: {}", connection.head->path, error.what());
    response.SetError({500, "internal", "the server failed; its log tells the organisers why"});
  }
  connection.close_after =
      connection.close_after || !connection.head->keep_alive || response.stream != nullptr;
  connection.out +=
      response.TakeBytes(connection.head->method == "HEAD", connection.close_after);
  connection.file = std::move(response.file);
  connection.stream = std::move(response.stream);
  // The body's place is free before the client knows that it may send the next.
  connection.body.Drop();
  connection.next = connection.Send() ? Connection::Next::kSend : Connection::Next::kClose;
  current = {};
}

void UnixHttpServer::Continue(Connection& connection) {
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload};
  std::optional<std::string> more;
  try {
    more = connection.stream->next();
  } catch (const std::exception& error) {
    spdlog::warn("a stream of {} ended: {}", connection.head->path, error.what());
  }
  connection.stream->due = Now() + connection.stream->every;
  connection.next = more.has_value() ? Connection::Next::kSend : Connection::Next::kClose;
  if (more.has_value()) connection.out += *more;
  current = {};
}

void UnixHttpServer::BeginStop() {
  stopping_ = true;
  gate_.Drain();
}

void UnixHttpServer::Shutdown() {
  BeginStop();
  gate_.Stop();
  queue_.Close();
  if (acceptor_.joinable()) acceptor_.join();
  // Nobody finds a socket at which nobody answers, however long the handlers take.
  if (!path_.empty()) unlink(path_.c_str());
  path_.clear();
  listener_.reset();
  network_.reset();
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
}

}  // namespace myograde::server
