// Content rows: configs and seed lists, each found by the SHA-256 of its text and never changed.
// Internal to the store.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>

namespace SQLite {
class Database;
}

namespace myograde::server {

// Each adds the row unless it is there. A damaged row (damage.h) if what is there under this hash is
// not this text.
absl::Status AddConfig(SQLite::Database& db, const std::string& hash, const std::string& track,
                       const std::string& profile, const std::string& json, int64_t now_ms);
absl::Status AddSeedList(SQLite::Database& db, const std::string& hash, int64_t count,
                         const std::string& json);

}  // namespace myograde::server
