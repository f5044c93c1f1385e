#include "server/http/acceptor.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/base/peer_key.h"
#include "server/http/response.h"

namespace myograde::server {
namespace {

constexpr size_t kSpareDescriptors = 8;

Fd AcceptFrom(int listener) {
  return Fd(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
}

constexpr int kBacklog = 1024;

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
absl::Status RemoveStale(const std::string& path, const sockaddr_un& address) {
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

void Reject(const AcceptedSocket& accepted, const ApiError& error) {
  if (accepted.from != nullptr && accepted.from->tls_of) return;
  SendRefusal(accepted.socket.get(), error);
}

void Acceptor::RestoreSpare() {
  while (spare_.size() < kSpareDescriptors) {
    Fd fd(::open("/dev/null", O_RDONLY | O_CLOEXEC));
    if (!fd.valid()) return;
    spare_.push_back(std::move(fd));
  }
}

Acceptor::Outcome Acceptor::Accept(const Listener& listener, AcceptedSocket& accepted) {
  RestoreSpare();
  accepted.from = &listener;
  accepted.socket = AcceptFrom(listener.fd);
  int error = accepted.socket.valid() ? 0 : errno;
  // One of the spare descriptors is for an organiser; whoever else it is hears why not. It is taken
  // back at once where it is not needed, which may well be: without descriptors, the kernel does not
  // even look whether somebody waits.
  const bool with_spare = (error == EMFILE || error == ENFILE) && !spare_.empty();
  if (with_spare) {
    spare_.pop_back();
    accepted.socket = AcceptFrom(listener.fd);
    error = accepted.socket.valid() ? 0 : errno;
  }
  std::optional<Peer> peer;
  if (error == 0) peer = listener.peer_of(accepted.socket.get());
  if (peer.has_value() && (peer->organiser || !with_spare)) {
    accepted.peer = *std::move(peer);
    return Outcome::kAccepted;
  }
  if (peer.has_value()) {
    Reject(accepted,
           {503, "too_many", "the server has no descriptors left for you; try again later"});
  }
  accepted.socket.reset();
  if (with_spare) RestoreSpare();
  if (error == 0 || error == EINTR || error == ECONNABORTED) return Outcome::kRejected;
  if (error == EAGAIN || error == EWOULDBLOCK) return Outcome::kNone;
  spdlog::warn("no connection can be accepted for now: {}",
               std::generic_category().message(error));
  return Outcome::kUnable;
}

absl::StatusOr<Fd> ListenAt(const std::string& path, unsigned mode) {
  ASSIGN_OR_RETURN(sockaddr_un address, AddressOf(path));
  RETURN_IF_ERROR(RemoveStale(path, address));
  Fd listener(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!listener.valid()) return Failed(path, "made");
  // Born with no rights for others; they come before anybody can connect. The kernel takes the
  // socket's own mode for its file; the mask would be the whole process', whose other threads make
  // files at this moment.
  if (fchmod(listener.get(), 0600) != 0) return Failed(path, "given its rights");
  if (bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Failed(path, "bound; check the folder's rights");
  }
  if (chmod(path.c_str(), mode) != 0) return Failed(path, "given its rights");
  if (::listen(listener.get(), kBacklog) != 0) return Failed(path, "listened on");
  return listener;
}

std::optional<Peer> UserAt(int fd) {
  ucred user = {};
  socklen_t size = sizeof(user);
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &user, &size) != 0) return std::nullopt;
  const std::string key = PeerKey(user.uid);
  Peer peer{
      .key = key, .organiser = IsOrganiser(key), .uid = user.uid, .groups = GroupsOf(fd)};
  peer.groups.push_back(user.gid);
  return peer;
}

}  // namespace myograde::server
