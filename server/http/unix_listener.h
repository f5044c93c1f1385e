// The daemon's Unix socket.
#pragma once

#include <optional>
#include <string>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/http/peer.h"

namespace myograde::server {

// Listens at `path` with the rights of `mode`, replacing a socket that nobody listens on.
// AlreadyExistsError: something listens there, or it is no socket.
absl::StatusOr<Fd> ListenAt(const std::string& path, unsigned mode);

// The user at the other end, as the kernel knows them; an organiser if they are root or run this
// process. nullopt: nobody is there.
std::optional<Peer> UserAt(int fd);

}  // namespace myograde::server
