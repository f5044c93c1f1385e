#include "server/base/peer_key.h"

#include <unistd.h>

#include <absl/strings/str_cat.h>

namespace myograde::server {

std::string PeerKey(uid_t uid) { return absl::StrCat("uid ", uid); }

bool IsOrganiser(const std::string& key) { return key == PeerKey(0) || key == PeerKey(geteuid()); }

}  // namespace myograde::server
