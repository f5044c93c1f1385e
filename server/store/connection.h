// SQLite connections, the schema that a store is brought to when it is opened, SQLite's errors as
// status values, and copies of a whole store as one file. Internal to the store.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/status/statusor.h>

#include "server/store/stored_row.h"

namespace myograde::server {

// An SQLite exception as one sentence about `path`; the kinds are in damage.h:
//   UnavailableError         busy or locked by another process, or an I/O error
//   PermissionDeniedError    read-only
//   ResourceExhaustedError   the disk is full
//   DataLossError            damaged, cut off, not a database, or without the store's tables
//   FailedPreconditionError  rejected by a constraint, type or trigger of the schema
absl::Status StatusOf(const std::string& path, const SQLite::Exception& error);

// Runs `body` and converts what it throws into such a status.
absl::Status GuardSqlite(const std::string& path, const std::function<absl::Status()>& body);

// Entry i brings a store from schema i (PRAGMA user_version) to i + 1. The first is schema.sql,
// which documents the tables, the states and the invariants.
using Migrations = std::span<const char* const>;
Migrations SchemaMigrations();

// Copies that are kept: of the stores before the latest two migrations.
inline constexpr int kKeptCopies = 2;

// The copy that is kept of a store at `path` of this schema.
std::string CopyBeforeMigration(const std::string& path, int schema);

// Opens the store at `path` for writing: creates it (0600) if it is missing, sets WAL,
// synchronous=FULL and foreign keys, and migrates it one version at a time, each in a transaction.
// An existing one is first copied to CopyBeforeMigration() (0600); without that copy, nothing
// changes. FailedPreconditionError: the file is no store, or one from before the first release, or
// its schema is newer than these; the message then names the newest copy that can be opened.
absl::StatusOr<std::unique_ptr<SQLite::Database>> OpenForWriting(
    const std::string& path, Migrations migrations = SchemaMigrations());

// Opens an existing store for reading.
absl::StatusOr<std::unique_ptr<SQLite::Database>> OpenForReading(const std::string& path);

// A value of the table meta, as text; "" if it is missing. These throw SQLite's exceptions.
std::string Meta(SQLite::Database& db, const std::string& key);
int64_t MetaNumber(SQLite::Database& db, const std::string& key);  // 0 if it is none
void SetMeta(SQLite::Database& db, const std::string& key, const std::string& value);

// Copies the database that `source` (of the file `name`) has open to the file `path`, in one read
// transaction, and checks the copy. `progress` gets page counts from time to time; damaged rows are
// copied as they are and passed to `damaged`. DataLossError: the database itself is damaged. Throws
// SQLite's exceptions, which are about `path`. On failure an incomplete file stays.
absl::Status CopyDatabase(SQLite::Database& source, const std::string& name,
                          const std::string& path,
                          const std::function<void(int64_t done, int64_t total)>& progress,
                          const std::function<void(const std::string& what)>& damaged);

}  // namespace myograde::server
