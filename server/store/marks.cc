// Marks on submissions, and the view that boards are built from.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/stored_row.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

constexpr char kMarkColumns[] = "SELECT m.id, m.at, m.submission, m.mark, m.set_to, m.who, m.why ";

StoredRow MarkOf(SQLite::Statement& select, MarkRow& mark) {
  StoredRow row(select, "mark", Shown(select.getColumn(0)));
  mark.id = row.Number(0, 1, INT64_MAX);
  mark.at = row.Time(1);
  mark.submission = row.Number(2, 1, INT64_MAX);
  mark.mark = row.OneOf(3, {"hidden", "disqualified", "baseline"});
  mark.set = row.Flag(4);
  mark.who = row.Text(5);
  mark.why = row.Text(6);
  return row;
}

// The numbers as raw memory.
std::string BytesOf(const std::vector<double>& numbers) {
  static_assert(std::endian::native == std::endian::little && sizeof(double) == 8);
  return std::string(reinterpret_cast<const char*>(numbers.data()), numbers.size() * 8);
}

std::vector<double> NumbersIn(StoredRow& row, int column) {
  const std::string bytes = row.Blob(column);
  std::vector<double> numbers(bytes.size() / 8);
  if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * 8);
  const bool any_infinite = std::any_of(numbers.begin(), numbers.end(),
                                        [](double number) { return std::isinf(number); });
  if (bytes.size() % 8 != 0 || any_infinite) row.Fail(column, "numbers belong there");
  return numbers;
}

// Reads the view's numbers and text, or neither; they can be rebuilt from the rows.
void ReadView(SQLite::Statement& select, Standing& standing) {
  StoredRow row(select, "standing", "");
  Standing read;
  read.aggregate_json = row.Text(4);
  read.ranked.successes = row.Number(5, 0, kMany);
  read.ranked.episodes = row.Number(6, 0, kMany);
  read.ranked.names = row.Text(7);
  read.ranked.numbers = NumbersIn(row, 8);
  if (row.ok()) standing = std::move(read);
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
  MendBoardState();
  SQLite::Statement insert(db_, "INSERT INTO mark (at, submission, mark, set_to, who, why) "
                                "VALUES (?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, submission, mark, set ? 1 : 0, who, why);
  insert.exec();
  return true;
}

absl::Status Writer::SetStanding(int64_t evaluation, const Standing& standing) {
  MendBoardState();
  SQLite::Statement insert(
      db_, "INSERT INTO standing VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (evaluation) "
           "DO UPDATE SET successes = excluded.successes, episodes = excluded.episodes, "
           "names = excluded.names, numbers = excluded.numbers, "
           "aggregate_json = excluded.aggregate_json");
  const RankedNumbers& ranked = standing.ranked;
  const std::string numbers = BytesOf(ranked.numbers);
  SQLite::bind(insert, evaluation, ranked.successes, ranked.episodes, ranked.names);
  insert.bind(5, numbers.data(), static_cast<int>(numbers.size()));
  insert.bind(6, standing.aggregate_json);
  insert.exec();
  return absl::OkStatus();
}

// The change counter is part of the view: an invalid row is replaced, with a count that no cached
// board can have.
void Writer::MendBoardState() {
  db_.exec("INSERT INTO board_state VALUES (1, abs(random()) % (1 << 50)) ON CONFLICT (id) DO "
           "UPDATE SET changes = excluded.changes WHERE typeof(changes) != 'integer' OR "
           "changes NOT BETWEEN 0 AND (1 << 51)");
}

absl::Status Writer::DropStandings() {
  MendBoardState();
  db_.exec("DELETE FROM standing");
  return absl::OkStatus();
}

MarksInForce Reader::Marks() {
  SQLite::Statement select(
      db_, absl::StrCat(kMarkColumns, "FROM mark AS m WHERE m.id = (SELECT max(id) FROM mark "
                        "WHERE submission IS m.submission AND mark IS m.mark) ORDER BY m.id"));
  MarksInForce marks;
  while (select.executeStep()) {
    MarkRow mark;
    const StoredRow row = MarkOf(select, mark);
    if (!row.ok()) {
      const SQLite::Column whose = select.getColumn(2);
      marks.damaged.emplace(whose.isInteger() ? whose.getInt64() : 0, *row.damage());
    } else if (mark.set) {
      marks.by_submission[mark.submission][mark.mark] = mark;
    }
  }
  return marks;
}

absl::StatusOr<std::vector<MarkRow>> Reader::MarkHistory(int64_t submission) {
  SQLite::Statement select(
      db_, absl::StrCat(kMarkColumns, "FROM mark AS m WHERE m.submission = ? ORDER BY m.id"));
  select.bind(1, submission);
  return AllOf<MarkRow>(select, {}, MarkOf);
}

int64_t Reader::BoardChanges() {
  SQLite::Statement select(db_, "SELECT changes FROM board_state WHERE typeof(changes) = 'integer'");
  return select.executeStep() ? select.getColumn(0).getInt64() : -1;
}

Listed<StandingRow> Reader::Standings(const std::string& config) {
  SQLite::Statement select(
      db_, "SELECT s.id, e.id, t.name, a.name, v.aggregate_json, v.successes, v.episodes, "
           "v.names, v.numbers, s.team_id, s.artefact, e.state, e.finished_at, t.banned "
           "FROM submission AS s LEFT JOIN team AS o ON o.id = s.team_id "
           "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) "
           "LEFT JOIN artefact AS a ON a.hash = s.artefact "
           "LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' "
           "LEFT JOIN standing AS v ON v.evaluation = e.id "
           "WHERE s.config = ? AND s.ranked = 1 AND (e.state IN ('queued', 'running', 'failed', "
           "'cancelled', 'grader_error')) IS NOT TRUE ORDER BY s.id");
  select.bind(1, config);
  Listed<StandingRow> listed;
  while (select.executeStep()) {
    StandingRow standing;
    StoredRow row(select, "submission", Shown(select.getColumn(0)));
    standing.submission = row.Number(0, 1, INT64_MAX);
    if (select.isColumnNull(1)) row.Fail("it has no original evaluation");
    standing.evaluation = row.NumberOr(1, 1, INT64_MAX, 0);
    row.Joined("evaluation", 1);
    (void)row.Named(11, ParseEvaluationState);
    standing.finished_at = row.Time(12);
    row.Joined("team", 9);
    standing.team = row.Text(2);
    const bool banned = row.Flag(13);
    row.Joined("artefact", 10);
    standing.artefact_name = row.Text(3);
    if (!row.ok()) {
      listed.damaged.push_back(*row.damage());
      continue;
    }
    if (banned) continue;
    ReadView(select, standing.standing);
    listed.rows.push_back(std::move(standing));
  }
  return listed;
}

std::vector<int64_t> Reader::DoneEvaluations(bool without_standing) {
  SQLite::Statement select(
      db_, "SELECT e.id FROM evaluation AS e LEFT JOIN standing AS v ON v.evaluation = e.id "
           "WHERE e.state = 'done' AND e.kind != 'rerun' AND (NOT ?1 OR v.evaluation IS NULL) "
           "ORDER BY e.id");
  select.bind(1, without_standing ? 1 : 0);
  std::vector<int64_t> ids;
  while (select.executeStep()) ids.push_back(select.getColumn(0).getInt64());
  return ids;
}

}  // namespace myograde::server
