// Whose something is.
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/episode_log.h"
#include "server/store/reader.h"
#include "server/store/teams.h"

namespace myograde::server {
namespace {

// The name in the query's first row; nullopt: there is no row, or no text in it.
std::optional<std::string> NameIn(SQLite::Statement& select) {
  if (!select.executeStep() || !select.getColumn(0).isText()) return std::nullopt;
  return select.getColumn(0).getString();
}

}  // namespace

bool Reader::MaySubmitArtefact(const std::string& hash, const std::string& who,
                               const std::string& team) {
  return UploadedArtefact(hash, who) || (!team.empty() && TeamHoldsArtefact(hash, team));
}

bool Reader::UploadedArtefact(const std::string& hash, const std::string& who) {
  SQLite::Statement select(
      db_, "SELECT 1 FROM artefact_holder WHERE artefact = ? AND uploader = ? LIMIT 1");
  SQLite::bind(select, hash, who);
  return select.executeStep();
}

bool Reader::TeamHoldsArtefact(const std::string& hash, const std::string& team) {
  SQLite::Statement submitted(
      db_, absl::StrCat("SELECT 1 FROM submission WHERE artefact = ?1 AND team_id IN ",
                        RowsOfTeam(2), " LIMIT 1"));
  SQLite::bind(submitted, hash, KnownTeamId(db_, team));
  if (submitted.executeStep()) return true;
  // By name, as a new team has no row before its first submission.
  SQLite::Statement select(
      db_, "SELECT DISTINCT team FROM artefact_holder WHERE artefact = ? AND team != ''");
  select.bind(1, hash);
  while (const std::optional<std::string> name = NameIn(select)) {
    if (TeamOf(*name) == TeamOf(team)) return true;
  }
  return false;
}

absl::StatusOr<std::string> Reader::TeamOfSubmission(int64_t id) {
  SQLite::Statement select(db_, "SELECT t.name FROM submission AS s JOIN team AS t "
                                "ON t.id = s.team_id WHERE s.id = ?");
  select.bind(1, id);
  const std::optional<std::string> name = NameIn(select);
  if (name.has_value()) return TeamOf(*name);
  return absl::NotFoundError(absl::StrCat("there is no submission ", id));
}

absl::StatusOr<std::string> Reader::TeamOfEvaluation(int64_t id) {
  SQLite::Statement select(db_, "SELECT t.name FROM evaluation AS e JOIN submission AS s "
                                "ON s.id = e.submission JOIN team AS t ON t.id = s.team_id "
                                "WHERE e.id = ?");
  select.bind(1, id);
  const std::optional<std::string> name = NameIn(select);
  if (name.has_value()) return TeamOf(*name);
  return absl::NotFoundError(absl::StrCat("there is no evaluation ", id));
}

std::set<std::string> Reader::TeamsOfLog(const std::string& sha256) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT DISTINCT t.name FROM episode AS p JOIN evaluation AS e "
                        "ON e.id = p.evaluation JOIN submission AS s ON s.id = e.submission "
                        "JOIN team AS t ON t.id = s.team_id WHERE (", kLogOfEpisode, ") = ?"));
  select.bind(1, sha256);
  std::set<std::string> teams;
  while (const std::optional<std::string> name = NameIn(select)) teams.insert(TeamOf(*name));
  return teams;
}

std::set<std::string> Reader::PhasesOfLog(const std::string& sha256) {
  SQLite::Statement select(
      db_, absl::StrCat("SELECT DISTINCT s.phase FROM episode AS p JOIN evaluation AS e "
                        "ON e.id = p.evaluation JOIN submission AS s ON s.id = e.submission "
                        "WHERE (", kLogOfEpisode, ") = ?"));
  select.bind(1, sha256);
  std::set<std::string> phases;
  while (const std::optional<std::string> name = NameIn(select)) phases.insert(*name);
  return phases;
}

}  // namespace myograde::server
