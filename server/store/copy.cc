#include "server/store/copy.h"

#include <sqlite3.h>

#include <SQLiteCpp/Backup.h>
#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

constexpr int kPagesAtOnce = 2048;
constexpr int kStepsAReport = 16;

// PRAGMA quick_check findings about rows; any other is about the file.
bool IsAboutARow(const std::string& finding) {
  return absl::StrContains(finding, " value in ") ||
         absl::StartsWith(finding, "CHECK constraint failed in ");
}

}  // namespace

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
  SQLite::Statement check(copy, "PRAGMA quick_check(1000)");
  while (check.executeStep()) {
    const std::string found = check.getColumn(0).getString();
    if (found == "ok") continue;
    if (!IsAboutARow(found)) {
      return absl::DataLossError(
          absl::StrCat(name, ": is damaged (", found, "); the backup was not kept"));
    }
    damaged(found);
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
