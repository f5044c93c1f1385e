#include <algorithm>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_image.h"
#include "server/base/error_code.h"
#include "server/store/stored_row.h"
#include "server/store/transaction.h"

namespace myograde::server {
namespace {

// An evaluation `e` of a submission `s` whose files may be removed: it has ended and can't stand on
// a board, nor on one that a rejudge is made for, which may have to play it. Unreadable rows keep
// their files.
std::string Over(const BoardState& board) {
  return absl::StrCat(
      "(e.finished_at IS NOT NULL AND "
      "(s.ranked = 0 OR e.state IN ('failed', 'cancelled', 'grader_error')) AND "
      "s.id NOT IN (",
      absl::StrJoin(board.NeededByRejudges(), ","), "))");
}

constexpr char kEpisodesOf[] =
    "FROM episode AS p LEFT JOIN evaluation AS e ON e.id = p.evaluation "
    "LEFT JOIN submission AS s ON s.id = e.submission ";

}  // namespace

absl::Status UnknownArtefact(const std::string& hash) {
  return absl::NotFoundError(absl::StrCat("there is no artefact ", hash, "; upload it first"));
}

absl::StatusOr<bool> Content::AddArtefact(const ArtefactRow& artefact) {
  return Run(db_, "INSERT INTO artefact VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
             artefact.hash, artefact.name, CanonicalJson(ManifestToJson(artefact)), artefact.bytes,
             artefact.files, now_ms_) == 1;
}

absl::Status Content::AddUpload(const ArtefactRow& artefact, const NewUpload& upload,
                                const UnsubmittedLimits& limits) {
  const absl::StatusOr<TeamInForce> known = Teams(context_).Named(upload.team);
  if (!known.ok() && !absl::IsNotFound(known.status())) return known.status();
  RETURN_IF_ERROR(Teams(context_).CheckNotBanned(known.value_or(TeamInForce())));
  const std::string team = known.ok() ? known->name : upload.team;
  Run(db_, "INSERT INTO artefact_holder VALUES (?, ?, ?) ON CONFLICT DO NOTHING", artefact.hash,
      upload.uploader, team);
  if (AnyRow(db_, "SELECT 1 FROM submission WHERE artefact = ? LIMIT 1", artefact.hash) ||
      Run(db_, "UPDATE upload SET at = ? WHERE artefact = ?", now_ms_, artefact.hash) > 0) {
    return absl::OkStatus();
  }
  const auto check = [&](const char* whose, const std::string& name, const std::string& sentence,
                         int64_t most, int64_t most_bytes) -> absl::Status {
    const auto [count, bytes] = FirstRow<int64_t, int64_t>(
        db_,
        absl::StrCat("SELECT count(*), ifnull(sum(a.bytes), 0) FROM upload AS u "
                     "JOIN artefact AS a ON a.hash = u.artefact WHERE ",
                     whose, " = ?"),
        name);
    if (count < most && artefact.bytes <= most_bytes - bytes) return absl::OkStatus();
    return CodedRefusal(
        "quota",
        absl::StrCat(sentence, " has ", count, " uploads of ", bytes,
                     " bytes together that were never submitted, and may have ", most, " of ",
                     most_bytes, " bytes; submit them, or try again later: each goes ",
                     absl::FormatDuration(limits.age), " after it came"));
  };
  RETURN_IF_ERROR(check("''", "", "this server", limits.count, limits.bytes));
  if (!upload.organiser) {
    RETURN_IF_ERROR(
        check("u.uploader", upload.uploader, upload.uploader, limits.of_one, limits.bytes_of_one));
  }
  if (!upload.organiser && !team.empty()) {
    RETURN_IF_ERROR(check("u.team", team, absl::StrCat("team \"", team, "\""), limits.of_one,
                          limits.bytes_of_one));
  }
  Run(db_, "INSERT INTO upload (artefact, uploader, team, at) VALUES (?, ?, ?, ?)", artefact.hash,
      upload.uploader, team, now_ms_);
  return absl::OkStatus();
}

absl::StatusOr<ArtefactRow> Content::Artefact(const std::string& hash) const {
  constexpr StoredRows<ArtefactRow, 4> kArtefacts = {
      .table = "artefact",
      .select = "SELECT hash, manifest_json, hash, bytes, files FROM artefact ",
      .first = 1};
  return kArtefacts.First(db_, UnknownArtefact(hash), "WHERE hash = ?", hash);
}

std::vector<ArtefactUse> Content::ArtefactUses() const {
  constexpr StoredRows<ArtefactUse, 4> kUses = {
      .table = "artefact",
      .select = "SELECT a.hash, a.bytes, max(a.created_at, ifnull(max(s.accepted_at), 0), "
                "ifnull(max(e.finished_at), 0)), ",
      // Files are removed by it.
      .wrong = [](const ArtefactUse& use) {
        return IsSha256Hex(use.hash) ? "" : "its \"hash\" is not 64 hexadecimal digits";
      }};
  return kUses
      .List(db_, absl::StrCat("ifnull(max(e.id IS NOT NULL AND ", Over(Board()),
                              " IS NOT TRUE), 0) FROM artefact AS a "
                              "LEFT JOIN submission AS s ON s.artefact = a.hash "
                              "LEFT JOIN evaluation AS e ON e.submission = s.id GROUP BY a.hash"))
      .rows;
}

std::vector<ArtefactUse> Content::Uploads() const {
  constexpr StoredRows<ArtefactUse, 3> kUploads = {
      "upload",
      "SELECT u.artefact, a.bytes, u.at FROM upload AS u JOIN artefact AS a ON a.hash = u.artefact "};
  return kUploads.List(db_, "ORDER BY u.at").rows;
}

std::set<std::string> Episodes::NeededLogs() const {
  return AllValues<std::string, std::set<std::string>>(
      db_, absl::StrCat("SELECT p.log ", kEpisodesOf, "WHERE p.log != '' AND ",
                        Over(Board()), " IS NOT TRUE"));
}

std::set<std::string> Episodes::PracticeLogs() const {
  return AllValues<std::string, std::set<std::string>>(
      db_, absl::StrCat("SELECT p.log ", kEpisodesOf, "WHERE p.log != '' AND s.ranked = 0 ",
                        "EXCEPT SELECT p.log ", kEpisodesOf, "WHERE ", Over(Board()),
                        " IS NOT TRUE AND s.ranked IS NOT 0"));
}

std::vector<std::string> Content::Hashes(const std::string& table) const {
  return AllValues<std::string>(
      db_, absl::StrCat("SELECT hash FROM \"", table, "\" ORDER BY hash"));
}

absl::StatusOr<bool> Content::Remove(const std::string& kind, const std::string& name,
                                     int64_t bytes, const std::string& why) {
  const bool upload = kind == kUploadKind;
  const bool practice = kind == kPracticeLogKind;
  const bool artefact = upload || kind == "artefact";
  std::string needed;
  if (artefact) {
    needed = absl::StrCat(
        "SELECT 1 FROM submission AS s JOIN evaluation AS e ON "
        "e.submission = s.id WHERE s.artefact = ?1 AND ",
        Over(Board()), " IS NOT TRUE LIMIT 1");
  } else {
    needed = absl::StrCat("SELECT 1 ", kEpisodesOf, "WHERE p.log = ?1 AND ", Over(Board()),
                          " IS NOT TRUE", practice ? " AND s.ranked IS NOT 0" : "", " LIMIT 1");
  }
  if (AnyRow(db_, needed, name)) return false;
  if (artefact) {
    const int taken = Run(db_, "DELETE FROM upload WHERE artefact = ?", name);
    if (taken == 0 && upload) return false;
  }
  Run(db_, R"(INSERT INTO removal (at, kind, name, bytes, why) VALUES (?, ?, ?, ?, ?))", now_ms_,
      artefact ? "artefact" : "log", name, bytes, why);
  return true;
}

bool Content::UploadedArtefact(const std::string& hash, const std::string& who) const {
  return AnyRow(db_, "SELECT 1 FROM artefact_holder WHERE artefact = ? AND uploader = ? LIMIT 1",
                hash, who);
}

bool Content::TeamHoldsArtefact(const std::string& hash, const std::string& team) const {
  if (AnyRow(db_,
             absl::StrCat("SELECT 1 FROM submission WHERE artefact = ?1 AND team_id IN ",
                          RowsOfTeam(2), " LIMIT 1"),
             hash, Teams(context_).IdOf(team))) {
    return true;
  }
  // By name, as a new team has no row before its first submission.
  const std::vector<std::string> names = AllValues<std::string>(
      db_, "SELECT DISTINCT team FROM artefact_holder WHERE artefact = ? AND team != ''", hash);
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
    return Teams(context_).NameOf(name) == Teams(context_).NameOf(team);
  });
}

std::map<std::string, std::set<std::string>> Episodes::TeamsOfLog(const std::string& sha256) const {
  Statement select(db_,
                   absl::StrCat("SELECT DISTINCT t.name, s.phase ", kEpisodesOf,
                                "JOIN team AS t ON t.id = s.team_id AND typeof(t.name) = 'text' "
                                "WHERE p.log = ?"),
                   sha256);
  std::map<std::string, std::set<std::string>> teams;
  while (select.executeStep()) {
    teams[Teams(context_).NameOf(select.getColumn(0))].insert(select.getColumn(1));
  }
  return teams;
}

absl::StatusOr<std::string> Content::Text(const char* table, const std::string& hash) const {
  Statement select(db_, absl::StrCat("SELECT content_json FROM ", table, " WHERE hash = ?"), hash);
  if (!select.executeStep()) {
    return DamagedRow({table, hash, "it is missing, and other rows name it"});
  }
  std::string text = select.getColumn(0);
  if (Sha256Hex(text) != hash) return DamagedRow({table, hash, "its content has another hash"});
  return text;
}

absl::Status Content::AddText(const char* table, const std::string& hash, const std::string& json) {
  Run(db_, absl::StrCat("INSERT INTO ", table, " VALUES (?, ?) ON CONFLICT DO NOTHING"), hash, json);
  if (AnyRow(db_, absl::StrCat("SELECT 1 FROM ", table, " WHERE hash = ? AND content_json = ?"),
             hash, json)) {
    return absl::OkStatus();
  }
  return DamagedRow({table, hash, "its content has another hash"});
}

}  // namespace myograde::server
