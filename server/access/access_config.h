// What server.json says of users of this host.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/access/role.h"

namespace myograde::server {

// One entry of server.json's access.users. Exactly one of uid, user, gid and group is given; user
// and group are names, which ResolveNames (server/config) turns into ids.
struct UserRule {
  std::optional<uid_t> uid;
  std::optional<gid_t> gid;
  std::string user;
  std::string group;
  Role role = Role::kParticipant;
  std::string team;  // of participants; "": none of its own
};

struct AccessConfig {
  std::vector<UserRule> users;
  int64_t teams_of_a_user = 1;  // that one user of this host may found, without a challenge
};

}  // namespace myograde::server
