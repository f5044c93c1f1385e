#include "server/store/connection.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>

#include <SQLiteCpp/Backup.h>
#include <absl/cleanup/cleanup.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

// How long a statement waits for a lock. Only the daemon writes, so a wait means that a person has
// the store open; a longer one would stall the daemon's loop.
constexpr int kBusyMs = 500;

bool IsFull(const std::string& path) {
  struct statvfs space;
  constexpr int64_t kLeast = 256 << 10;  // of a new store's write-ahead log with its index
  return statvfs(path.substr(0, path.rfind('/') + 1).c_str(), &space) == 0 &&
         static_cast<int64_t>(space.f_bavail * space.f_frsize) < kLeast;
}

int64_t SizeOf(const std::string& file) {
  struct stat info;
  return stat(file.c_str(), &info) == 0 ? static_cast<int64_t>(info.st_size) : 0;
}

// SQLite takes half a page at the end for a whole one. Only for a file that has all pages: the last ones
// may still be in a write-ahead log.
absl::Status CheckLength(SQLite::Database& db, const std::string& path) {
  const int64_t pages = db.execAndGet("PRAGMA page_count").getInt64();
  const int64_t needed = pages * db.execAndGet("PRAGMA page_size").getInt64();
  const int64_t size = SizeOf(path);
  if (size >= needed) return absl::OkStatus();
  return CorruptStore(absl::StrCat(path, ": was cut off: it has ", size, " bytes of ", needed,
                                   "; restore it from a backup"));
}

// PRAGMA quick_check findings about rows; any other is about the file.
bool IsAboutARow(const std::string& finding) {
  return absl::StrContains(finding, " value in ") ||
         absl::StartsWith(finding, "CHECK constraint failed in ");
}

// What is wrong with the file itself; "": nothing. What is wrong with rows is passed to `damaged`.
std::string QuickCheck(SQLite::Database& db,
                       const std::function<void(const std::string& what)>& damaged) {
  for (const std::string& found : AllValues<std::string>(db, "PRAGMA quick_check(1000)")) {
    if (found == "ok") continue;
    if (!IsAboutARow(found)) return found;
    damaged(found);
  }
  return "";
}

// What an earlier start, a disk or a person left in the rows of a store that is opened: each row
// that its table would refuse, or that names one which is not there, is passed to `damaged`.
absl::Status CheckRows(SQLite::Database& db, const std::string& path,
                       const std::function<void(const std::string& what)>& damaged) {
  if (const std::string found = QuickCheck(db, damaged); !found.empty()) {
    return CorruptStore(absl::StrCat(path, ": is damaged (", found, "); restore it from a backup"));
  }
  SQLite::Statement keys(
      db, "SELECT \"table\", rowid, parent FROM pragma_foreign_key_check LIMIT 1000");
  while (keys.executeStep()) {
    damaged(absl::StrCat("row ", keys.getColumn(1).getString(), " of ",
                         keys.getColumn(0).getString(), " names a row of ",
                         keys.getColumn(2).getString(), " that is not there"));
  }
  return absl::OkStatus();
}

constexpr int kPagesAtOnce = 2048;
constexpr int kStepsAReport = 16;

}  // namespace

absl::Status StatusOf(const std::string& path, const SQLite::Exception& error) {
  const std::string cause = absl::StrCat(" (SQLite: ", error.what(), ")");
  switch (error.getErrorCode()) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::UnavailableError(
          absl::StrCat(path, ": is locked by another process; close what has it open", cause));
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
    case SQLITE_CANTOPEN:
      return absl::PermissionDeniedError(absl::StrCat(
          path, ": can't be opened or written; check the rights of the file and its folder, and "
          "that its disk is not mounted read-only", cause));
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return CorruptStore(
          absl::StrCat(path, ": is damaged or no store; restore it from a backup", cause));
    case SQLITE_ERROR:  // a statement of this program failed: a table or a column is missing
    case SQLITE_SCHEMA:
      return absl::DataLossError(absl::StrCat(
          path, ": its tables are not those of a store; restore it from a backup", cause));
    case SQLITE_CONSTRAINT:
    case SQLITE_MISMATCH:  // text as a row's id
      return absl::FailedPreconditionError(absl::StrCat(path, ": refused", cause));
    case SQLITE_IOERR:
      // The write-ahead log lacks what was written to it.
      if (error.getExtendedErrorCode() == SQLITE_IOERR_SHORT_READ) {
        return CorruptStore(absl::StrCat(
            path, ": its write-ahead log was cut off; restore the store from a backup", cause));
      }
      if (!IsFull(path)) break;  // else its files beside the database can't grow
      [[fallthrough]];
    case SQLITE_FULL:
      return absl::ResourceExhaustedError(
          absl::StrCat(path, ": the disk is full; make room", cause));
    default:
      break;
  }
  return absl::UnavailableError(absl::StrCat(path, ": reading or writing failed", cause));
}

absl::Status GuardSqlite(const std::string& path, const std::function<absl::Status()>& body) {
  try {
    return body();
  } catch (const SQLite::Exception& error) {
    return StatusOf(path, error);
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat(path, ": ", error.what()));
  }
}

absl::StatusOr<std::unique_ptr<SQLite::Database>> OpenForReading(const std::string& path) {
  std::unique_ptr<SQLite::Database> db;
  RETURN_IF_ERROR(GuardSqlite(path, [&] {
    db = std::make_unique<SQLite::Database>(path, SQLite::OPEN_READWRITE, kBusyMs);
    db->exec("PRAGMA query_only = ON");
    db->exec("PRAGMA cache_size = -1024");  // KiB; the host keeps the file in memory as well
    return absl::OkStatus();
  }));
  return db;
}

std::string Meta(SQLite::Database& db, const std::string& key) {
  return FirstValue<std::string>(db, "SELECT CAST(value AS TEXT) FROM meta WHERE key = ?", key);
}

int64_t MetaNumber(SQLite::Database& db, const std::string& key) {
  int64_t number = 0;
  return absl::SimpleAtoi(Meta(db, key), &number) ? number : 0;
}

void SetMeta(SQLite::Database& db, const std::string& key, const std::string& value) {
  Run(db, R"(INSERT INTO meta
      VALUES (?, CAST(? AS BLOB)) ON CONFLICT (key) DO UPDATE SET value = excluded.value)",
      key, value);
}

absl::Status CopyDatabase(SQLite::Database& source, const std::string& name,
                          const std::string& path,
                          const std::function<void(int64_t done, int64_t total)>& progress,
                          const std::function<void(const std::string& what)>& damaged) {
  // One state from the first page to the last: an open read transaction keeps other writes from
  // restarting the copy.
  SQLite::Transaction transaction(source);
  source.execAndGet("SELECT count(*) FROM meta");
  SQLite::Database copy(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  {
    SQLite::Backup backup(copy, source);
    for (int step = 0; backup.executeStep(kPagesAtOnce) != SQLITE_DONE; ++step) {
      if (step % kStepsAReport != 0) continue;
      const int total = backup.getTotalPageCount();
      progress(total - backup.getRemainingPageCount(), total);
    }
  }
  // The copy is a single file: it needs no write-ahead log.
  copy.exec("PRAGMA journal_mode = DELETE");
  // An unreadable row is copied as it is.
  const std::string found = QuickCheck(copy, damaged);
  if (found.empty()) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrCat(name, ": is damaged (", found, "); the backup was not kept"));
}

// --- the schema ---

namespace {

namespace fs = std::filesystem;

constexpr int kApplicationId = 0x4d794772;  // as schema.sql sets it

int SchemaOf(SQLite::Database& db) { return db.execAndGet("PRAGMA user_version").getInt(); }

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

// Whether the file is a store that these can open.
absl::Status CheckSchema(SQLite::Database& db, const std::string& path, Migrations migrations) {
  const int version = SchemaOf(db);
  const int known = static_cast<int>(migrations.size());
  const bool ours = db.execAndGet("PRAGMA application_id").getInt() == kApplicationId;
  if (ours && version > known) {
    const int copy = NewestCopy(path, known);
    const std::string older =
        copy < 0 ? "a backup that was made with this one"
                 : absl::StrCat("the copy from before the upgrade, ",
                                CopyBeforeMigration(path, copy));
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": has schema ", version, ", this program knows up to ", known,
                     "; use the newer program that wrote it, or restore ", older));
  }
  if (ours || db.execAndGet("SELECT count(*) FROM sqlite_master").getInt() == 0) {
    return absl::OkStatus();
  }
  // Without our id.
  const bool unreleased =
      version > 0 && db.tableExists("submission") && db.tableExists("transition");
  return absl::FailedPreconditionError(
      unreleased
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
  spdlog::info("migrated the store from schema {} to {}; {} is a copy of the old one", from, to,
               copy);
  return absl::OkStatus();
}

}  // namespace

std::string CopyBeforeMigration(const std::string& path, int schema) {
  return absl::StrCat(path, ".schema-", schema);
}

absl::StatusOr<std::unique_ptr<SQLite::Database>> OpenForWriting(const std::string& path,
                                                                 Migrations migrations) {
  std::unique_ptr<SQLite::Database> opened;
  RETURN_IF_ERROR(GuardSqlite(path, [&]() -> absl::Status {
    {
      const absl::Cleanup restore = [mask = umask(0077)] { umask(mask); };
      opened = std::make_unique<SQLite::Database>(
          path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE, kBusyMs);
    }
    SQLite::Database& db = *opened;
    const bool whole = SizeOf(path + "-wal") == 0;
    RETURN_IF_ERROR(CheckSchema(db, path, migrations));
    if (whole) RETURN_IF_ERROR(CheckLength(db, path));
    RETURN_IF_ERROR(CheckRows(db, path, [&](const std::string& what) {
      spdlog::error("{}: {}; what needs it can't be shown or played", path, what);
    }));
    // An episode's row is over a kilobyte and fits into such a page; with the usual 4096 bytes it
    // would need an overflow page. Only effective before a new file's first page is written.
    if (SchemaOf(db) == 0) db.exec("PRAGMA page_size = 8192");
    db.exec("PRAGMA journal_mode = WAL");
    db.exec("PRAGMA synchronous = FULL");
    db.exec("PRAGMA foreign_keys = ON");
    return Migrate(db, path, migrations);
  }));
  return opened;
}

}  // namespace myograde::server
