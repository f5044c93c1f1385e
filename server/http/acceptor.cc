#include "server/http/acceptor.h"

#include <fcntl.h>
#include <sys/socket.h>

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>

#include <spdlog/spdlog.h>

#include "server/http/response.h"

namespace myograde::server {
namespace {

constexpr size_t kSpareDescriptors = 8;

Fd AcceptFrom(int listener) {
  return Fd(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
}

bool NoneWaits(int error) { return error == EAGAIN || error == EWOULDBLOCK; }

}  // namespace

void Reject(const AcceptedSocket& accepted, const ApiError& error) {
  if (accepted.from != nullptr && accepted.from->tls_of) return;
  SendRefusal(accepted.socket.get(), error);
}

Acceptor::Acceptor() { RestoreSpare(); }

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
  if (!accepted.socket.valid()) {
    const int error = errno;
    if (error == EINTR || error == ECONNABORTED) return Outcome::kRejected;
    if (NoneWaits(error)) return Outcome::kNone;
    if ((error == EMFILE || error == ENFILE) && !spare_.empty()) {
      return AcceptWithSpare(listener, accepted);
    }
    spdlog::warn("no connection can be accepted for now: {}",
                 std::generic_category().message(error));
    return Outcome::kUnable;
  }
  std::optional<Peer> peer = listener.peer_of(accepted.socket.get());
  if (!peer.has_value()) {
    accepted.socket.reset();
    return Outcome::kRejected;
  }
  accepted.peer = *std::move(peer);
  return Outcome::kAccepted;
}

// One of the spare descriptors is for an organiser; whoever else it is hears why not. It is taken
// back at once where it is not needed, which may well be: without descriptors, the kernel does not
// even look whether somebody waits.
Acceptor::Outcome Acceptor::AcceptWithSpare(const Listener& listener, AcceptedSocket& accepted) {
  spare_.pop_back();
  accepted.socket = AcceptFrom(listener.fd);
  const int error = accepted.socket.valid() ? 0 : errno;
  std::optional<Peer> peer;
  if (error == 0) peer = listener.peer_of(accepted.socket.get());
  if (peer.has_value() && peer->organiser) {
    accepted.peer = *std::move(peer);
    return Outcome::kAccepted;
  }
  if (peer.has_value()) {
    Reject(accepted,
         {503, "too_many", "the server has no descriptors left for you; try again later"});
  }
  accepted.socket.reset();
  RestoreSpare();
  if (NoneWaits(error)) return Outcome::kNone;
  return error == EMFILE || error == ENFILE ? Outcome::kUnable : Outcome::kRejected;
}

}  // namespace myograde::server
