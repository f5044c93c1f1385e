// Whose something is.
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/episode_log.h"
#include "server/store/reader.h"

namespace myograde::server {
namespace {

// The name in the query's first row; nullopt: there is no row, or no text in it.
std::optional<std::string> NameIn(SQLite::Statement& select) {
  if (!select.executeStep() || !select.getColumn(0).isText()) return std::nullopt;
  return select.getColumn(0).getString();
}

}  // namespace

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
