// Users and groups of this host by name.
#pragma once

#include <string>

#include <absl/status/status.h>

#include "server/access/identity.h"

namespace myograde::server {

// Turns the names in `access` into ids, as the host's user database has them now.
// InvalidArgumentError that names the entry, with `where` in front: this host has no such user or
// group.
absl::Status ResolveNames(const std::string& where, AccessConfig& access);

}  // namespace myograde::server
