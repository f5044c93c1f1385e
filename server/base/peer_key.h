// Identifies the peer of a connection, for limits, rows and the organiser's rights.
#pragma once

#include <sys/types.h>

#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// The key of a user of this host, such as "uid 1000": limits count by it, and rows record it as the
// submitter.
std::string PeerKey(uid_t uid);

// True for root and for this process' user: an organiser's shell, or a service that runs as the
// daemon's user and submits on behalf of many people.
bool IsOrganiser(const std::string& key);

// The key of a user of this host, who is given by name ("ada"), by number ("1001"), or by the key
// itself ("uid 1001"). InvalidArgumentError: there is no such user.
absl::StatusOr<std::string> PersonNamed(const std::string& text);

}  // namespace myograde::server
