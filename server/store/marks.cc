// Marks on submissions, and the view that boards are made of.
#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

constexpr char kMarkColumns[] = "SELECT m.id, m.at, m.submission, m.mark, m.set_to, m.who, m.why ";

MarkRow MarkOf(SQLite::Statement& row) {
  MarkRow mark;
  mark.id = row.getColumn(0).getInt64();
  mark.at = row.getColumn(1).getInt64();
  mark.submission = row.getColumn(2).getInt64();
  mark.mark = row.getColumn(3).getString();
  mark.set = row.getColumn(4).getInt() != 0;
  mark.who = row.getColumn(5).getString();
  mark.why = row.getColumn(6).getString();
  return mark;
}

std::optional<double> NumberIn(SQLite::Statement& row, int column) {
  if (row.isColumnNull(column)) return std::nullopt;
  return row.getColumn(column).getDouble();
}

}  // namespace

absl::StatusOr<bool> Writer::Mark(int64_t submission, const std::string& mark, bool set,
                                  const std::string& who, const std::string& why) {
  SQLite::Statement exists(db_, "SELECT 1 FROM submission WHERE id = ?");
  exists.bind(1, submission);
  if (!exists.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", submission));
  }
  SQLite::Statement last(db_, "SELECT set_to, why FROM mark WHERE submission = ? AND mark = ? "
                              "ORDER BY id DESC LIMIT 1");
  SQLite::bind(last, submission, mark);
  const bool there = last.executeStep();
  const bool is_set = there && last.getColumn(0).getInt() != 0;
  const bool same_reason = !there || why.empty() || last.getColumn(1).getString() == why;
  if (is_set == set && (!set || same_reason)) return false;
  SQLite::Statement insert(db_, "INSERT INTO mark (at, submission, mark, set_to, who, why) "
                                "VALUES (?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, submission, mark, set ? 1 : 0, who, why);
  insert.exec();
  return true;
}

absl::Status Writer::SetStanding(int64_t evaluation, const std::string& aggregate_json) {
  const absl::StatusOr<RankedNumbers> numbers = ParseRankedNumbers(aggregate_json);
  if (!numbers.ok()) return numbers.status();
  SQLite::Statement insert(
      db_, "INSERT INTO standing VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (evaluation) "
           "DO UPDATE SET successes = excluded.successes, episodes = excluded.episodes, time_s = "
           "excluded.time_s, effort = excluded.effort, pain = excluded.pain, distance_m = "
           "excluded.distance_m, effort_over_steps = excluded.effort_over_steps, "
           "pain_over_steps = excluded.pain_over_steps, aggregate_json = excluded.aggregate_json");
  SQLite::bind(insert, evaluation, numbers->successes, numbers->episodes, numbers->time_s);
  int column = 5;
  for (const auto& number : {numbers->effort, numbers->pain, numbers->distance_m,
                             numbers->effort_over_steps, numbers->pain_over_steps}) {
    if (number) insert.bind(column, *number);  // unbound is NULL
    ++column;
  }
  insert.bind(column, aggregate_json);
  insert.exec();
  return absl::OkStatus();
}

absl::Status Writer::DropStandings() {
  db_.exec("DELETE FROM standing");
  return absl::OkStatus();
}

std::map<int64_t, std::map<std::string, MarkRow>> Reader::Marks() {
  SQLite::Statement select(
      db_, absl::StrCat(kMarkColumns, "FROM mark AS m WHERE m.set_to = 1 AND m.id = (SELECT "
                        "max(id) FROM mark WHERE submission = m.submission AND mark = m.mark)"));
  std::map<int64_t, std::map<std::string, MarkRow>> marks;
  while (select.executeStep()) {
    MarkRow row = MarkOf(select);
    marks[row.submission][row.mark] = row;
  }
  return marks;
}

std::vector<MarkRow> Reader::MarkHistory(int64_t submission) {
  SQLite::Statement select(
      db_, absl::StrCat(kMarkColumns, "FROM mark AS m WHERE m.submission = ? ORDER BY m.id"));
  select.bind(1, submission);
  std::vector<MarkRow> rows;
  while (select.executeStep()) rows.push_back(MarkOf(select));
  return rows;
}

int64_t Reader::BoardChanges() {
  return db_.execAndGet("SELECT changes FROM board_state").getInt64();
}

std::vector<StandingRow> Reader::Standings(const std::string& config) {
  SQLite::Statement select(
      db_, "SELECT s.id, e.id, t.name, a.name, v.aggregate_json, v.successes, v.episodes, "
           "v.time_s, v.effort, v.pain, v.distance_m, v.effort_over_steps, v.pain_over_steps "
           "FROM submission AS s "
           "JOIN team AS t ON t.id = s.team_id JOIN artefact AS a ON a.hash = s.artefact "
           "JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' "
           "LEFT JOIN standing AS v ON v.evaluation = e.id "
           "WHERE s.config = ? AND s.ranked = 1 AND e.state = 'done' ORDER BY s.id");
  select.bind(1, config);
  std::vector<StandingRow> rows;
  while (select.executeStep()) {
    StandingRow row;
    row.submission = select.getColumn(0).getInt64();
    row.evaluation = select.getColumn(1).getInt64();
    row.team = select.getColumn(2).getString();
    row.artefact_name = select.getColumn(3).getString();
    row.aggregate_json = select.getColumn(4).getString();
    row.numbers.successes = select.getColumn(5).getInt64();
    row.numbers.episodes = select.getColumn(6).getInt64();
    row.numbers.time_s = select.getColumn(7).getDouble();
    row.numbers.effort = NumberIn(select, 8);
    row.numbers.pain = NumberIn(select, 9);
    row.numbers.distance_m = NumberIn(select, 10);
    row.numbers.effort_over_steps = NumberIn(select, 11);
    row.numbers.pain_over_steps = NumberIn(select, 12);
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<int64_t> Reader::DoneEvaluations(bool without_standing) {
  SQLite::Statement select(
      db_, "SELECT e.id FROM evaluation AS e LEFT JOIN standing AS v ON v.evaluation = e.id "
           "WHERE e.state = 'done' AND e.kind = 'original' AND (NOT ?1 OR v.evaluation IS NULL) "
           "ORDER BY e.id");
  select.bind(1, without_standing ? 1 : 0);
  std::vector<int64_t> ids;
  while (select.executeStep()) ids.push_back(select.getColumn(0).getInt64());
  return ids;
}

}  // namespace myograde::server
