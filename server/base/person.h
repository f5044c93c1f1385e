// Users of this host as people may write them.
#pragma once

#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

// The key (PeerKey) of a user of this host, who is given by name ("ada"), by number ("1001"), or by
// the key itself ("uid 1001"). InvalidArgumentError: there is no such user.
absl::StatusOr<std::string> PersonNamed(const std::string& text);

}  // namespace myograde::server
