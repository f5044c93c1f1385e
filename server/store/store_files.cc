// A whole store as a file: backups, and what comes from an export.
#include <sqlite3.h>

#include <SQLiteCpp/Backup.h>
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

// An evaluation `e` of a submission `s` whose files are never removed.
constexpr char kNeeded[] =
    "(e.id IS NOT NULL AND (e.finished_at IS NULL OR (s.ranked = 1 AND e.state = 'done')))";

constexpr int kPagesAtOnce = 2048;
constexpr int kStepsAReport = 16;

}  // namespace

absl::Status ReaderPool::Backup(const std::string& path,
                                const std::function<void(int64_t, int64_t)>& progress) {
  absl::StatusOr<std::unique_ptr<SQLite::Database>> source = OpenForReading(path_);
  if (!source.ok()) return source.status();
  return GuardSqlite(path, [&]() -> absl::Status {
    // One state from the first page to the last: while a reading transaction is open, what
    // others write does not make the copy begin again.
    SQLite::Transaction transaction(**source);
    (*source)->execAndGet("SELECT count(*) FROM meta");
    SQLite::Database copy(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    {
      SQLite::Backup backup(copy, **source);
      for (int step = 0; backup.executeStep(kPagesAtOnce) != SQLITE_DONE; ++step) {
        if (step % kStepsAReport != 0) continue;
        const int total = backup.getTotalPageCount();
        progress(total - backup.getRemainingPageCount(), total);
      }
    }
    // The copy is one file: it needs no log of changes beside it.
    copy.exec("PRAGMA journal_mode = DELETE");
    const std::string found = copy.execAndGet("PRAGMA quick_check(1)").getString();
    if (found != "ok") {
      return absl::DataLossError(absl::StrCat(path_, ": is damaged (", found, "); the backup was "
                                              "not kept"));
    }
    return absl::OkStatus();
  });
}

std::vector<ArtefactUse> Reader::ArtefactUses() {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT a.hash, a.bytes, max(a.created_at, ifnull(max(s.accepted_at), 0), "
                        "ifnull(max(e.finished_at), 0)), ifnull(max(", kNeeded, "), 0) "
                        "FROM artefact AS a LEFT JOIN submission AS s ON s.artefact = a.hash "
                        "LEFT JOIN evaluation AS e ON e.submission = s.id GROUP BY a.hash"));
  std::vector<ArtefactUse> uses;
  while (select.executeStep()) {
    uses.push_back({select.getColumn(0).getString(), select.getColumn(1).getInt64(),
                    select.getColumn(2).getInt64(), select.getColumn(3).getInt() != 0});
  }
  return uses;
}

std::set<std::string> Reader::NeededLogs() {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT json_extract(p.facts_json, '$.log.sha256') FROM episode AS p "
                        "JOIN evaluation AS e ON e.id = p.evaluation "
                        "JOIN submission AS s ON s.id = e.submission WHERE ", kNeeded));
  std::set<std::string> logs;
  while (select.executeStep()) {
    if (!select.getColumn(0).isNull()) logs.insert(select.getColumn(0).getString());
  }
  return logs;
}

absl::StatusOr<bool> Writer::Remove(const std::string& kind, const std::string& name,
                                    int64_t bytes, const std::string& why) {
  if (kind == "artefact") {
    SQLite::Statement needed(
        db_, absl::StrCat("SELECT 1 FROM submission AS s JOIN evaluation AS e ON "
                          "e.submission = s.id WHERE s.artefact = ? AND ", kNeeded, " LIMIT 1"));
    needed.bind(1, name);
    if (needed.executeStep()) return false;
  }
  SQLite::Statement insert(db_, "INSERT INTO removal (at, kind, name, bytes, why) "
                                "VALUES (?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, kind, name, bytes, why);
  insert.exec();
  return true;
}

absl::Status Writer::Import(const std::string& path, const ExportInfo& info,
                            const std::string& who) {
  if (absl::Status status = ImportRows(db_, path, info); !status.ok()) return status;
  FillTeamLooks(db_);
  constexpr char kWhy[] = "had not ended when it was exported; hand it in again";
  Reader reader(db_);
  absl::Status status;
  for (const EvaluationRow& evaluation : reader.Unfinished()) {
    for (const LeaseRow& lease : reader.Leases(evaluation.id)) {
      if (IsFinal(lease.state)) continue;
      status.Update(EndLease(lease.id, LeaseState::kCancelled, /*fault=*/false, who, kWhy));
    }
    status.Update(EndEvaluation(evaluation.id, EvaluationState::kCancelled, kWhy, "", who));
  }
  return status;
}

}  // namespace myograde::server
