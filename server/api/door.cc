#include "server/api/door.h"

#include <fcntl.h>
#include <sys/socket.h>

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>

#include <spdlog/spdlog.h>

#include "server/api/http_request.h"

namespace myograde::server {
namespace {

constexpr size_t kSpareDescriptors = 8;

Fd AcceptFrom(int listener) {
  return Fd(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
}

bool NobodyWaits(int error) { return error == EAGAIN || error == EWOULDBLOCK; }

}  // namespace

void Tell(const Newcomer& newcomer, const ApiError& error) {
  if (newcomer.from != nullptr && newcomer.from->transport_of) return;
  const std::string text = RefusalBytes(error);
  [[maybe_unused]] const ssize_t n =
      ::send(newcomer.socket.get(), text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

Door::Door() { RestoreSpare(); }

void Door::RestoreSpare() {
  while (spare_.size() < kSpareDescriptors) {
    Fd fd(::open("/dev/null", O_RDONLY | O_CLOEXEC));
    if (!fd.valid()) return;
    spare_.push_back(std::move(fd));
  }
}

Door::Found Door::Accept(const Listener& listener, Newcomer& newcomer) {
  RestoreSpare();
  newcomer.from = &listener;
  newcomer.socket = AcceptFrom(listener.fd);
  if (!newcomer.socket.valid()) {
    const int error = errno;
    if (error == EINTR || error == ECONNABORTED) return Found::kSentAway;
    if (NobodyWaits(error)) return Found::kNobody;
    if ((error == EMFILE || error == ENFILE) && !spare_.empty()) {
      return AcceptWithSpare(listener, newcomer);
    }
    spdlog::warn("no connection can be accepted for now: {}",
                 std::generic_category().message(error));
    return Found::kCantAccept;
  }
  std::optional<Peer> peer = listener.peer_of(newcomer.socket.get());
  if (!peer.has_value()) {
    newcomer.socket.reset();
    return Found::kSentAway;
  }
  newcomer.peer = *std::move(peer);
  return Found::kNewcomer;
}

// One of the spare descriptors is for an organiser; whoever else it is hears why not. It is taken
// back at once where it is not needed, which may well be: without descriptors, the kernel does not
// even look whether somebody waits.
Door::Found Door::AcceptWithSpare(const Listener& listener, Newcomer& newcomer) {
  spare_.pop_back();
  newcomer.socket = AcceptFrom(listener.fd);
  const int error = newcomer.socket.valid() ? 0 : errno;
  std::optional<Peer> peer;
  if (error == 0) peer = listener.peer_of(newcomer.socket.get());
  if (peer.has_value() && peer->organiser) {
    newcomer.peer = *std::move(peer);
    return Found::kNewcomer;
  }
  if (peer.has_value()) {
    Tell(newcomer,
         {503, "too_many", "the server has no descriptors left for you; try again later"});
  }
  newcomer.socket.reset();
  RestoreSpare();
  if (NobodyWaits(error)) return Found::kNobody;
  return error == EMFILE || error == ENFILE ? Found::kCantAccept : Found::kSentAway;
}

}  // namespace myograde::server
