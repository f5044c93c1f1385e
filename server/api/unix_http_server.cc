#include "server/api/unix_http_server.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <algorithm>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

constexpr int kBacklog = 1024;

absl::Duration Now() { return SystemClock().Monotonic(); }

// What a handler may ask about the request of its own thread.
struct CurrentRequest {
  uid_t uid = 0;
  absl::Duration deadline;
  absl::Duration upload;
  bool hang_up = false;
};
thread_local CurrentRequest current;

// Waits for `events`, at most until the request's deadline.
bool WaitFor(int fd, short events) {
  for (;;) {
    const absl::Duration left = current.deadline - Now();
    if (left <= absl::ZeroDuration()) return false;
    pollfd entry = {fd, events, 0};
    const int64_t ms = std::min<int64_t>(absl::ToInt64Milliseconds(left) + 1, 60'000);
    const int n = poll(&entry, 1, static_cast<int>(ms));
    if (n > 0) return true;
    if (n < 0 && errno != EINTR) return false;
  }
}

// One connection as cpp-httplib sees it. Reads are buffered, since it asks for
// single bytes while it looks for the end of a header line.
class UnixStream : public httplib::Stream {
 public:
  explicit UnixStream(int fd) : fd_(fd) {}

  bool is_readable() const override { return begin_ < end_ || WaitFor(fd_, POLLIN); }
  bool is_writable() const override { return WaitFor(fd_, POLLOUT); }

  ssize_t read(char* to, size_t size) override {
    if (begin_ == end_) {
      if (!WaitFor(fd_, POLLIN)) return -1;
      const ssize_t n = recv(fd_, buffer_, sizeof(buffer_), 0);
      if (n <= 0) return n;
      begin_ = 0;
      end_ = static_cast<size_t>(n);
    }
    const size_t n = std::min(size, end_ - begin_);
    std::memcpy(to, buffer_ + begin_, n);
    begin_ += n;
    return static_cast<ssize_t>(n);
  }

  ssize_t write(const char* from, size_t size) override {
    if (!WaitFor(fd_, POLLOUT)) return -1;
    return send(fd_, from, size, MSG_NOSIGNAL);
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = "unix";
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip = "unix";
    port = 0;
  }
  socket_t socket() const override { return fd_; }

  // A client sent more than its request: it does not wait for answers.
  bool has_leftover() const { return begin_ < end_; }

 private:
  int fd_;
  char buffer_[16384];
  size_t begin_ = 0;
  size_t end_ = 0;
};

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

UnixHttpServer::UnixHttpServer(const HttpLimits& limits)
    : limits_(limits), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

UnixHttpServer::~UnixHttpServer() { Shutdown(); }

void UnixHttpServer::AllowUploadTime() { current.deadline = Now() + current.upload; }

void UnixHttpServer::HangUpAfter() { current.hang_up = true; }

void UnixHttpServer::Drain(const httplib::ContentReader& content, int64_t most) {
  HangUpAfter();
  content([&](const char*, size_t size) { return (most -= static_cast<int64_t>(size)) > 0; });
}

uid_t UnixHttpServer::PeerUid() { return current.uid; }

absl::Status UnixHttpServer::Bind(const std::string& path) {
  absl::StatusOr<sockaddr_un> address = AddressOf(path);
  if (!address.ok()) return address.status();
  if (absl::Status status = MakeRoom(path, *address); !status.ok()) return status;
  listener_ = Fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!listener_.valid()) return Failed(path, "made");
  // Born with no rights for others; they come before anybody can connect.
  const mode_t mask = umask(0177);
  const int bound = bind(listener_.get(), reinterpret_cast<const sockaddr*>(&*address),
                         sizeof(*address));
  const int error = errno;
  umask(mask);
  errno = error;
  if (bound != 0) return Failed(path, "bound; check the folder's rights");
  path_ = path;
  if (chmod(path.c_str(), limits_.socket_mode) != 0) return Failed(path, "given its rights");
  if (::listen(listener_.get(), kBacklog) != 0) return Failed(path, "listened on");
  return absl::OkStatus();
}

absl::Status UnixHttpServer::Start(const std::string& path) {
  if (absl::Status status = Bind(path); !status.ok()) return status;
  // cpp-httplib takes a server without a listener for one that stops, and cuts files off.
  svr_sock_ = listener_.get();
  for (int i = 0; i < limits_.workers; ++i) workers_.emplace_back([this] { Work(); });
  acceptor_ = std::thread([this] { AcceptLoop(); });
  return absl::OkStatus();
}

void UnixHttpServer::Wake() {
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(wake_.get(), &one, sizeof(one));
}

void UnixHttpServer::AcceptOne() {
  const int fd = accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) return;
  idle_[fd] = Now() + limits_.idle;
  const std::lock_guard lock(mutex_);
  ++open_;
}

// Owns the connections that wait for their client: hands those with something to
// read to the workers, takes them back afterwards, and hangs up on the silent.
void UnixHttpServer::AcceptLoop() {
  for (;;) {
    std::vector<pollfd> fds = {{wake_.get(), POLLIN, 0}};
    bool room;
    {
      const std::lock_guard lock(mutex_);
      if (stop_) break;
      for (const int fd : returned_) idle_[fd] = Now() + limits_.idle;
      returned_.clear();
      room = open_ < limits_.clients;
    }
    for (const auto& [fd, until] : idle_) fds.push_back({fd, POLLIN, 0});
    if (room) fds.push_back({listener_.get(), POLLIN, 0});
    poll(fds.data(), fds.size(), 1000);
    uint64_t count;
    [[maybe_unused]] const ssize_t n = ::read(wake_.get(), &count, sizeof(count));
    if (room && fds.back().revents != 0) AcceptOne();
    for (size_t i = 1; i < fds.size() - (room ? 1 : 0); ++i) {
      const auto it = idle_.find(fds[i].fd);
      const bool readable = fds[i].revents != 0;
      if (!readable && Now() < it->second) continue;
      idle_.erase(it);
      const std::lock_guard lock(mutex_);
      if (readable) {
        requests_.push_back(fds[i].fd);
        ready_.notify_one();
      } else {
        close(fds[i].fd);
        --open_;
      }
    }
  }
  for (const auto& [fd, until] : idle_) close(fd);
  idle_.clear();
}

void UnixHttpServer::Work() {
  for (;;) {
    int fd;
    {
      std::unique_lock lock(mutex_);
      ready_.wait(lock, [this] { return stop_ || !requests_.empty(); });
      if (stop_) return;
      fd = requests_.front();
      requests_.pop_front();
    }
    const bool keep = ServeOne(fd);
    const std::lock_guard lock(mutex_);
    if (keep && !stop_) {
      returned_.push_back(fd);
    } else {
      close(fd);
      --open_;
    }
    Wake();
  }
}

bool UnixHttpServer::ServeOne(int fd) {
  ucred peer = {};
  socklen_t size = sizeof(peer);
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) != 0) return false;
  current = {peer.uid, Now() + limits_.request, limits_.upload, false};
  UnixStream stream(fd);
  bool closed = false;
  // Every answer is whole. A kilobyte of ranges could ask for the same file a thousand times,
  // and cpp-httplib does not hold them against a file's end.
  const bool served = process_request(stream, /*close_connection=*/false, closed,
                                      [](httplib::Request& request) { request.ranges.clear(); });
  return served && !closed && !current.hang_up && !stream.has_leftover();
}

void UnixHttpServer::Shutdown() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  ready_.notify_all();
  Wake();
  if (acceptor_.joinable()) acceptor_.join();
  for (std::thread& worker : workers_) worker.join();
  workers_.clear();
  for (const int fd : requests_) close(fd);
  for (const int fd : returned_) close(fd);
  requests_.clear();
  returned_.clear();
  svr_sock_ = INVALID_SOCKET;
  listener_.reset();
  if (!path_.empty()) unlink(path_.c_str());
  path_.clear();
}

}  // namespace myograde::server
