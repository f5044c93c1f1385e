// A whole store as a file: backups and imports.
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/copy.h"
#include "server/store/episode_log.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

// An evaluation `e` of a submission `s` whose files may be removed: it has ended and can't stand on
// a board, nor on one that a rejudge is made for, which may have to play it. Unreadable rows keep
// their files.
constexpr char kOver[] =
    "(e.finished_at IS NOT NULL AND "
    "(s.ranked = 0 OR e.state IN ('failed', 'cancelled', 'grader_error')) AND NOT "
    "(s.ranked = 1 AND EXISTS (SELECT 1 FROM rejudge AS q WHERE q.purpose = 'rules' AND "
    "q.phase = s.phase AND (SELECT event FROM rejudge_event WHERE rejudge = q.id "
    "ORDER BY id DESC LIMIT 1) = 'created' AND (q.from_config = s.config OR EXISTS "
    "(SELECT 1 FROM rejudge_item AS i JOIN rejudge AS before ON before.id = i.rejudge "
    "WHERE i.submission = s.id AND before.to_config = q.from_config)))))";

constexpr char kEpisodesOf[] =
    "FROM episode AS p LEFT JOIN evaluation AS e ON e.id = p.evaluation "
    "LEFT JOIN submission AS s ON s.id = e.submission ";

// In unreadable text, any run of 64 hexadecimal digits is taken for a log's hash.
void AddHashesIn(const std::string& text, std::set<std::string>& hashes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  for (size_t begin = text.find_first_of(kDigits); begin != std::string::npos;) {
    const size_t end = std::min(text.find_first_not_of(kDigits, begin), text.size());
    if (end - begin == 64) hashes.insert(text.substr(begin, 64));
    begin = text.find_first_of(kDigits, end);
  }
}

}  // namespace

absl::Status ReaderPool::Backup(const std::string& path,
                                const std::function<void(int64_t, int64_t)>& progress,
                                const std::function<void(const std::string&)>& damaged) {
  ASSIGN_OR_RETURN(std::unique_ptr<SQLite::Database> source, OpenForReading(path_));
  return GuardSqlite(path,
                     [&] { return CopyDatabase(*source, path_, path, progress, damaged); });
}

std::vector<ArtefactUse> Reader::ArtefactUses() {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT a.hash, a.bytes, max(a.created_at, ifnull(max(s.accepted_at), 0), "
                        "ifnull(max(e.finished_at), 0)), "
                        "ifnull(max(e.id IS NOT NULL AND ", kOver, " IS NOT TRUE), 0) "
                        "FROM artefact AS a LEFT JOIN submission AS s ON s.artefact = a.hash "
                        "LEFT JOIN evaluation AS e ON e.submission = s.id GROUP BY a.hash"));
  std::vector<ArtefactUse> uses;
  while (select.executeStep()) {
    StoredRow row(select, "artefact", Shown(select.getColumn(0)));
    ArtefactUse use{row.Hash(0), row.Number(1, 0, INT64_MAX), row.Time(2), row.Flag(3)};
    if (row.ok()) uses.push_back(std::move(use));
  }
  return uses;
}

std::vector<UploadRow> Reader::Uploads() {
  SQLite::Statement select(db_, "SELECT u.artefact, a.bytes, u.at FROM upload AS u "
                                "JOIN artefact AS a ON a.hash = u.artefact ORDER BY u.at");
  std::vector<UploadRow> uploads;
  while (select.executeStep()) {
    uploads.push_back({select.getColumn(0).getString(), select.getColumn(1).getInt64(),
                       select.getColumn(2).getInt64()});
  }
  return uploads;
}

// The logs of the episodes for which `condition` holds.
std::set<std::string> Reader::LogsWhere(const std::string& condition) {
  SQLite::Statement select(db_, absl::StrCat("SELECT ", kLogOfEpisode, ", p.facts_json ", kEpisodesOf,
                                             "WHERE ", condition, " AND (", kLogOfEpisode,
                                             ") IS NOT ''"));
  std::set<std::string> logs;
  while (select.executeStep()) {
    AddHashesIn(select.getColumn(select.isColumnNull(0) ? 1 : 0).getString(), logs);
  }
  return logs;
}

std::set<std::string> Reader::NeededLogs() { return LogsWhere(absl::StrCat(kOver, " IS NOT TRUE")); }

std::set<std::string> Reader::PracticeLogs() {
  std::set<std::string> logs = LogsWhere("s.ranked = 0");
  for (const std::string& log : LogsWhere(absl::StrCat(kOver, " IS NOT TRUE AND s.ranked IS NOT 0"))) {
    logs.erase(log);
  }
  return logs;
}

std::vector<std::string> Reader::Hashes(const std::string& table) {
  SQLite::Statement select(db_, absl::StrCat("SELECT hash FROM \"", table, "\" ORDER BY hash"));
  std::vector<std::string> hashes;
  while (select.executeStep()) hashes.push_back(select.getColumn(0).getString());
  return hashes;
}

absl::StatusOr<bool> Writer::Remove(const std::string& kind, const std::string& name,
                                    int64_t bytes, const std::string& why) {
  const bool upload = kind == kUploadKind;
  const bool practice = kind == kPracticeLogKind;
  const bool artefact = upload || kind == "artefact";
  std::string needed;
  if (artefact) {
    needed = absl::StrCat("SELECT 1 FROM submission AS s JOIN evaluation AS e ON "
                          "e.submission = s.id WHERE s.artefact = ?1 AND ", kOver,
                          " IS NOT TRUE LIMIT 1");
  } else {
    const std::string open = absl::StrCat(kOver, " IS NOT TRUE",
                                          practice ? " AND s.ranked IS NOT 0 " : " ");
    // Of unreadable facts, those that contain the name anywhere.
    needed = absl::StrCat("SELECT 1 ", kEpisodesOf, "WHERE (", kLogOfEpisode, ") = ?1 AND ", open,
                          "UNION ALL SELECT 1 ", kEpisodesOf, "WHERE (", kLogOfEpisode,
                          ") IS NULL AND instr(p.facts_json, ?1) > 0 AND ", open, "LIMIT 1");
  }
  SQLite::Statement select(db_, needed);
  select.bind(1, name);
  if (select.executeStep()) return false;
  if (artefact) {
    SQLite::Statement taken(db_, "DELETE FROM upload WHERE artefact = ?");
    taken.bind(1, name);
    if (taken.exec() == 0 && upload) return false;
  }
  SQLite::Statement insert(db_, "INSERT INTO removal (at, kind, name, bytes, why) "
                                "VALUES (?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, upload ? std::string("artefact") : practice ? std::string("log") : kind,
               name, bytes, why);
  insert.exec();
  return true;
}

absl::Status Writer::Import(const std::string& path, const ExportInfo& info,
                            const std::string& who,
                            const std::function<absl::Status(Reader&)>& check) {
  RETURN_IF_ERROR(ImportRows(db_, path, info));
  FillTeamLooks(db_);
  Reader reader(db_);
  if (absl::Status read = check(reader); !read.ok()) {
    if (!DamageOf(read).has_value()) return read;
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": has a row that no request could read (", read.message(),
        "); nothing was imported: export again from a store that is well"));
  }
  constexpr char kWhy[] = "had not ended when it was exported; hand it in again";
  for (const int64_t evaluation : OpenEvaluations()) {
    RETURN_IF_ERROR(EndWithLeases(evaluation, EvaluationState::kCancelled, kWhy, who));
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
