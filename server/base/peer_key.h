// Who is at the other end of a connection, as limits, rows and the organiser's rights know them.
#pragma once

#include <sys/types.h>

#include <string>

namespace myograde::server {

// The key of a user of this host, "uid 1000": what limits count by, and what rows say of who
// handed something in.
std::string PeerKey(uid_t uid);

// True for root and for the user of this process: an organiser's shell, or a service of the
// daemon's own user, which hands in what many people made.
bool IsOrganiser(const std::string& key);

}  // namespace myograde::server
