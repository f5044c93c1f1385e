// SQLite connections, SQLite's errors as status values, and copies of a whole store as one file.
// Internal to the store.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/status/statusor.h>

#include "server/store/migration.h"
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

// Opens the store at `path` for writing: creates it (0600) if it is missing, sets WAL,
// synchronous=FULL and foreign keys, and migrates it to the newest schema; errors also as in
// migration.h.
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
