// The daemon's Unix socket, and how connections are accepted and who is at their other end found
// out, there and on the network (tcp_listener.h).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/http/request.h"
#include "server/http/peer.h"

namespace myograde::server {

struct TlsContext;

// A socket that connections come in at.
struct Listener {
  int fd = -1;  // must not block
  // Who is at the other end of an accepted socket; nullopt: hang up.
  std::function<std::optional<Peer>(int fd)> peer_of;
  // The certificate of its connections; empty: plain HTTP.
  std::function<std::shared_ptr<TlsContext>()> tls_of = {};
};

// A connection of which nothing was read.
struct AcceptedSocket {
  Fd socket;
  Peer peer;
  const Listener* from = nullptr;  // nullptr: of plain HTTP
};

// Tells why it is closed, if the socket takes that at once. With TLS nothing can be said before a
// handshake.
void Reject(const AcceptedSocket& accepted, const ApiError& error);

// Accepts also when no descriptor is left but a few that are kept for that.
class Acceptor {
 public:
  Acceptor() { RestoreSpare(); }

  // kAccepted: `accepted` was filled in. kRejected: there was one, and it was rejected. kNone: none
  // waits. kUnable: there are no descriptors or no memory, and trying again at once would only burn
  // time.
  enum class Outcome { kAccepted, kRejected, kNone, kUnable };
  // `listener` must outlive what was accepted.
  Outcome Accept(const Listener& listener, AcceptedSocket& accepted);
  // Opens the kept descriptors that were given up, as far as there are any again. Accept does so
  // too, as whatever gets free is theirs first.
  void RestoreSpare();

 private:
  std::vector<Fd> spare_;  // descriptors to give up when there are no others
};

// Listens at `path` with the rights of `mode`, replacing a socket that nobody listens on.
// AlreadyExistsError: something listens there, or it is not a socket.
absl::StatusOr<Fd> ListenAt(const std::string& path, unsigned mode);

// The user at the other end, as the kernel knows them; an organiser if they are root or run this
// process. nullopt: nobody is there.
std::optional<Peer> UserAt(int fd);

}  // namespace myograde::server
