// The versions of the store's schema. The text of each is in schema_vN.sql,
// which also holds the drawing of the states and the invariants.
#pragma once

#include <span>

namespace myograde::server {

// Entry i takes a store from user_version i to i + 1.
std::span<const char* const> SchemaMigrations();

}  // namespace myograde::server
