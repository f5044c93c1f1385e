// The store's schema, and how a store of an earlier one is brought to it; a copy of what it was is
// kept.
#pragma once

#include <span>
#include <string>

#include <absl/status/status.h>

namespace SQLite {
class Database;
}

namespace myograde::server {

// Entry i brings a store from schema i (PRAGMA user_version) to i + 1. The first is schema.sql,
// which documents the tables, the states and the invariants.
using Migrations = std::span<const char* const>;
Migrations SchemaMigrations();

// Copies that are kept: of the stores before the latest two migrations.
inline constexpr int kKeptCopies = 2;

// The copy that is kept of a store at `path` of this schema.
std::string CopyBeforeMigration(const std::string& path, int schema);

// FailedPreconditionError: the file at `path` is no store, or one from before the first release, or
// its schema is newer than these; the message then names the newest copy that can be opened.
absl::Status CheckSchema(SQLite::Database& db, const std::string& path, Migrations migrations);

// Migrates the store at `path`, open as `db`, one version at a time and each in one transaction.
// An existing one is first copied to CopyBeforeMigration() (0600), which is logged; without that
// copy, nothing changes. Not thread-safe.
absl::Status Migrate(SQLite::Database& db, const std::string& path, Migrations migrations);

}  // namespace myograde::server
