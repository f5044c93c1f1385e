#include "server/store/migration.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/store/connection.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr int kApplicationId = 0x4d794772;  // as schema.sql sets it

int SchemaOf(SQLite::Database& db) { return db.execAndGet("PRAGMA user_version").getInt(); }

// Whether a database that has no id of ours holds a store of before the first release.
bool IsUnreleased(SQLite::Database& db) {
  return SchemaOf(db) > 0 && db.tableExists("submission") && db.tableExists("transition");
}

// The schema of the newest copy beside a store that is of `schema` or an earlier one; -1: there is
// none.
int NewestCopy(const std::string& path, int schema) {
  std::error_code error;
  while (schema >= 0 && !fs::exists(CopyBeforeMigration(path, schema), error)) --schema;
  return schema;
}

// What was written is on the disk, so that a power cut after the migration does not take the copy.
absl::Status Sync(const std::string& path, int flags) {
  const Fd fd(open(path.c_str(), flags | O_RDONLY | O_CLOEXEC));
  if (fd.valid() && fsync(fd.get()) == 0) return absl::OkStatus();
  return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be written to its disk"));
}

absl::Status CopyTo(SQLite::Database& db, const std::string& path, const std::string& copy) {
  const std::string draft = copy + ".draft";
  // A journal that a killed process left would be rolled back into the new file.
  const auto remove = [&] {
    std::error_code error;
    for (const char* part : {"", "-journal"}) fs::remove(draft + part, error);
  };
  remove();
  const absl::Cleanup remove_at_end = remove;
  // Made here, as SQLite would give it the rights that the umask leaves.
  if (!Fd(open(draft.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600)).valid()) {
    return absl::ErrnoToStatus(errno, absl::StrCat(draft, ": can't be created"));
  }
  RETURN_IF_ERROR(GuardSqlite(copy, [&] {
    return CopyDatabase(db, path, draft, [](int64_t, int64_t) {}, [](const std::string&) {});
  }));
  RETURN_IF_ERROR(Sync(draft, 0));
  if (rename(draft.c_str(), copy.c_str()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(copy, ": can't be created"));
  }
  return Sync(fs::path(copy).parent_path().string(), O_DIRECTORY);
}

// Of those of `schema`, which was copied last, and of earlier ones.
void RemoveOldCopies(const std::string& path, int schema) {
  std::error_code error;
  for (int kept = 0; (schema = NewestCopy(path, schema)) >= 0; --schema) {
    if (++kept > kKeptCopies) fs::remove(CopyBeforeMigration(path, schema), error);
  }
}

}  // namespace

std::string CopyBeforeMigration(const std::string& path, int schema) {
  return absl::StrCat(path, ".schema-", schema);
}

absl::Status CheckSchema(SQLite::Database& db, const std::string& path, Migrations migrations) {
  const int version = SchemaOf(db);
  const int known = static_cast<int>(migrations.size());
  const bool ours = db.execAndGet("PRAGMA application_id").getInt() == kApplicationId;
  if (ours && version > known) {
    const int copy = NewestCopy(path, known);
    const std::string older =
        copy < 0 ? "a backup that was made with this one"
                 : absl::StrCat("the copy from before the upgrade, ", CopyBeforeMigration(path, copy));
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": has schema ", version, ", this program knows up to ", known,
                     "; use the newer program that wrote it, or restore ", older));
  }
  if (ours || db.execAndGet("SELECT count(*) FROM sqlite_master").getInt() == 0) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      IsUnreleased(db)
          ? absl::StrCat(path, ": is a store of schema ", version,
                         " from before the first release, "
                         "which this program can't read; use the program that wrote it, or give "
                         "--data a new folder")
          : absl::StrCat(path, ": is an SQLite database of something else; move it away"));
}

absl::Status Migrate(SQLite::Database& db, const std::string& path, Migrations migrations) {
  const int from = SchemaOf(db);
  const int to = static_cast<int>(migrations.size());
  if (from == to) return absl::OkStatus();
  const std::string copy = CopyBeforeMigration(path, from);
  if (from > 0) {
    if (absl::Status status = CopyTo(db, path, copy); !status.ok()) {
      return absl::Status(
          status.code(),
          absl::StrCat(status.message(), "; it is the copy that is kept of ", path,
                       " before its schema changes from ", from, " to ", to,
                       ", and without it the store stays as it is"));
    }
  }
  for (size_t i = static_cast<size_t>(from); i < migrations.size(); ++i) {
    SQLite::Transaction transaction(db, SQLite::TransactionBehavior::IMMEDIATE);
    db.exec(migrations[i]);
    db.exec(absl::StrCat("PRAGMA user_version = ", i + 1));
    transaction.commit();
  }
  if (from == 0) return absl::OkStatus();
  RemoveOldCopies(path, from);
  spdlog::info("migrated the store from schema {} to {}; {} is a copy of the old one", from, to, copy);
  return absl::OkStatus();
}

}  // namespace myograde::server
