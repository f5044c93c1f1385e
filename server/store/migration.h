// Brings a store of an earlier schema to this program's, and keeps a copy of what it was.
#pragma once

#include <optional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace SQLite {
class Database;
}

namespace myograde::server {

// Copies that are kept: of the stores before the latest two migrations.
inline constexpr int kKeptCopies = 2;

struct Migration {
  int from = 0;
  int to = 0;
  std::string copy;  // the file with the store as it was
};

// The copy that is kept of a store at `path` of this schema.
std::string CopyBeforeMigration(const std::string& path, int schema);

// FailedPreconditionError: the file at `path` is no store, or its schema is newer than this program;
// the message then names the newest copy that this program can open.
absl::Status CheckSchema(SQLite::Database& db, const std::string& path);

// Migrates the store at `path`, open as `db`, one version at a time and each in one transaction.
// An existing one is first copied to CopyBeforeMigration() (0600); without that copy, nothing
// changes. nullopt: the schema was this program's, or the store is new. Not thread-safe.
absl::StatusOr<std::optional<Migration>> Migrate(SQLite::Database& db, const std::string& path);

}  // namespace myograde::server
