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
#include <string_view>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"

namespace myograde::server {
namespace {

constexpr int kBacklog = 1024;
// Beyond the first an answer begins to be sent while it is made, beyond the second
// its handler waits for the client.
constexpr size_t kSendFrom = 256 << 10;
constexpr size_t kMaxUnsent = 16 << 20;
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
  Peer caller;
};
thread_local CurrentRequest current;

// cpp-httplib tells of every answer without a body how long that is, which HTTP forbids for these,
// and which is not so of a stream; and of a limit of requests that connections don't have.
std::string HeadToSend(std::string_view head, bool streams) {
  const bool bodiless = head.starts_with("HTTP/1.1 204 ") || head.starts_with("HTTP/1.1 304 ");
  std::string sent;
  for (size_t at = 0, end = 0; at < head.size(); at = end) {
    end = std::min(head.find("\r\n", at), head.size() - 2) + 2;
    const std::string_view line = head.substr(at, end - at);
    if (line.starts_with("Keep-Alive:")) continue;
    if ((bodiless || streams) && line == "Content-Length: 0\r\n") continue;
    sent += line;
  }
  return sent;
}

// A request that is there as a whole, as cpp-httplib reads it.
class WholeRequest : public httplib::Stream {
 public:
  WholeRequest(Connection& connection, bool close) : connection_(connection) {
    head_ = connection.head->canonical;
    if (connection.head->method != "GET" && connection.head->method != "HEAD") {
      absl::StrAppend(&head_, "Content-Length: ", connection.body.size(), "\r\n");
    }
    head_ += close ? "Connection: close\r\n\r\n" : "\r\n";
  }

  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }

  ssize_t read(char* to, size_t size) override {
    if (read_ < head_.size()) {
      const size_t n = head_.copy(to, size, read_);
      read_ += n;
      return static_cast<ssize_t>(n);
    }
    const ssize_t n = connection_.body.ReadAt(to, size, body_read_);
    body_read_ += std::max<ssize_t>(n, 0);
    return n;
  }

  // The first write is the answer's head.
  ssize_t write(const char* from, size_t size) override {
    if (answered_) {
      connection_.out.append(from, size);
    } else {
      connection_.out += HeadToSend({from, size}, connection_.stream != nullptr);
    }
    answered_ = true;
    if (connection_.unsent() >= kSendFrom && !connection_.Send()) return -1;
    while (connection_.unsent() > kMaxUnsent) {
      if (*current.stopping || Now() >= current.deadline) return -1;
      // The kinds of poll are those of epoll.
      const auto kinds = static_cast<short>(connection_.transport->Wants(/*to_send=*/true));
      pollfd entry = {connection_.fd.get(), kinds, 0};
      poll(&entry, 1, 100);
      if (!connection_.Send()) return -1;
    }
    return static_cast<ssize_t>(size);
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = current.caller.key;
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip = current.caller.network ? "network" : "unix";
    port = 0;
  }
  // Any number would do, but cpp-httplib takes none that select() could not.
  socket_t socket() const override { return 0; }

 private:
  Connection& connection_;
  std::string head_;
  size_t read_ = 0;
  int64_t body_read_ = 0;
  bool answered_ = false;
};

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
             .rule_of = [this](const RequestHead& head) { return RuleOf(head); },
             .on_refusal =
                 [this](int http) {
                   if (count_refusal_ != nullptr) count_refusal_(http);
                 }},
            queue_) {}

UnixHttpServer::~UnixHttpServer() { Shutdown(); }

bool UnixHttpServer::Stopping() { return *current.stopping; }

Body& UnixHttpServer::RequestBody() { return current.connection->body; }

absl::Status UnixHttpServer::AnswerWithFile(const std::string& path, const char* type,
                                            httplib::Response& response) {
  Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info;
  if (!file.valid() || fstat(file.get(), &info) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be read"));
  }
  response.set_header("Content-Type", type);
  response.set_header("Content-Length", absl::StrCat(info.st_size));
  if (current.connection->head->method == "HEAD") return absl::OkStatus();
  current.connection->file = {std::move(file), 0, info.st_size};
  return absl::OkStatus();
}

void UnixHttpServer::AnswerWithStream(const char* type, absl::Duration every, absl::Duration time,
                                      std::function<std::optional<std::string>()> next,
                                      httplib::Response& response) {
  response.set_header("Content-Type", type);
  response.set_header("Connection", "close");  // ends it
  current.connection->close_after = true;
  if (current.connection->head->method == "HEAD") return;
  const absl::Duration now = Now();
  current.connection->stream = std::make_unique<Stream>(
      Stream{std::move(next), every, /*due=*/now, /*began=*/now, /*until=*/now + time});
}

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

void UnixHttpServer::SetBodyRule(const std::string& path, BodyRule rule) {
  if (path.find('(') == std::string::npos) {
    rules_[path] = std::move(rule);
  } else {
    pattern_rules_.emplace_back(std::regex(path), std::move(rule));
  }
}

BodyRule UnixHttpServer::RuleOf(const RequestHead& head) const {
  const auto it = rules_.find(head.path);
  if (it != rules_.end() && head.method == "POST") return it->second;
  for (const auto& [pattern, rule] : pattern_rules_) {
    if (head.method == "POST" && std::regex_match(head.path, pattern)) return rule;
  }
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
  // cpp-httplib takes a server without a listener for one that stops, and cuts files off.
  svr_sock_ = listener_.get();
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
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload,
             connection.Asker()};
  const bool close = !connection.head->keep_alive;
  WholeRequest stream(connection, close);
  bool closed = false;
  const bool served = process_request(stream, /*close_connection=*/false, closed, nullptr);
  connection.close_after = connection.close_after || close || closed || !served;
  // The body's place is free before the client knows that it may send the next.
  connection.body.Drop();
  connection.next = connection.Send() ? Connection::Next::kSend : Connection::Next::kClose;
  current = {};
}

void UnixHttpServer::Continue(Connection& connection) {
  current = {&connection, &stopping_, Now() + limits_.request, limits_.upload,
             connection.Asker()};
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
  svr_sock_ = INVALID_SOCKET;
  listener_.reset();
  network_.reset();
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
}

}  // namespace myograde::server
