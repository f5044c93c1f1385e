// The versions of the store's schema. The text of each is in schema_vN.sql, along with the state
// diagram and the invariants.
#pragma once

#include <span>

namespace myograde::server {

// Entry i migrates a store from user_version i to i + 1.
std::span<const char* const> SchemaMigrations();

}  // namespace myograde::server
