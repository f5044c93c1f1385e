// SQLite connections, and SQLite's errors as status values. Internal to the store.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>
#include <absl/status/statusor.h>

#include "server/store/migration.h"

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

struct OpenedStore {
  std::unique_ptr<SQLite::Database> db;
  std::optional<Migration> migration;
};

// Opens the store at `path` for writing: creates it (0600) if it is missing, sets WAL,
// synchronous=FULL and foreign keys, and migrates it to this program's schema; errors also as in
// migration.h.
absl::StatusOr<OpenedStore> OpenForWriting(const std::string& path);

// Opens an existing store for reading.
absl::StatusOr<std::unique_ptr<SQLite::Database>> OpenForReading(const std::string& path);

}  // namespace myograde::server
