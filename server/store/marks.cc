// Marks on submissions, and the view that boards are built from.
#include <bit>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

constexpr char kMarkColumns[] = "SELECT m.id, m.at, m.submission, m.mark, m.set_to, m.who, m.why ";

StoredRow MarkOf(SQLite::Statement& select, MarkRow& mark) {
  StoredRow row(select, "mark");
  mark.id = row.Id(0);
  mark.at = row.Time(1);
  mark.submission = row.Id(2);
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

}  // namespace

absl::StatusOr<bool> Writer::Mark(int64_t submission, const std::string& mark, bool set,
                                  const std::string& who, const std::string& why) {
  if (!AnyRow(db_, "SELECT 1 FROM submission WHERE id = ?", submission)) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", submission));
  }
  Statement last(db_, R"(SELECT set_to, why
      FROM mark WHERE submission = ? AND mark = ? ORDER BY id DESC LIMIT 1)",
                 submission, mark);
  const bool there = last.executeStep();
  const bool is_set = there && last.getColumn(0).getInt() != 0;
  const bool same_reason = !there || why.empty() || last.getColumn(1).getString() == why;
  if (is_set == set && (!set || same_reason)) return false;
  MendBoardState();
  Run(db_, R"(INSERT INTO mark (at, submission, mark, set_to, who, why)
      VALUES (?, ?, ?, ?, ?, ?))",
      now_ms_, submission, mark, set, who, why);
  AppendEntry(db_, kMarkedEntry, db_.getLastInsertRowid());
  return true;
}

absl::Status Writer::SetStanding(int64_t evaluation, const Standing& standing) {
  MendBoardState();
  const RankedNumbers& ranked = standing.ranked;
  Run(db_, R"(INSERT INTO standing VALUES (?, ?, ?, ?, CAST(? AS BLOB), ?) ON CONFLICT
      (evaluation) DO UPDATE SET successes = excluded.successes, episodes = excluded.episodes, names
      = excluded.names, numbers = excluded.numbers, aggregate_json = excluded.aggregate_json)",
      evaluation, ranked.successes, ranked.episodes, ranked.names, BytesOf(ranked.numbers),
      standing.aggregate_json);
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

MarksInForce Reader::Marks(int64_t before_ms) {
  Statement select(db_,
                   absl::StrCat(kMarkColumns,
                                "FROM mark AS m WHERE m.id = (SELECT max(id) FROM mark "
                                "WHERE submission IS m.submission AND mark IS m.mark AND at < ?) "
                                "ORDER BY m.id"),
                   before_ms);
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
  return AllOf<MarkRow>(
      Statement(db_,
                absl::StrCat(kMarkColumns, "FROM mark AS m WHERE m.submission = ? ORDER BY m.id"),
                submission),
      MarkOf);
}

int64_t Reader::BoardChanges() {
  Statement select(db_, "SELECT changes FROM board_state WHERE typeof(changes) = 'integer'");
  return select.executeStep() ? select.getColumn(0).getInt64() : -1;
}

std::vector<int64_t> Reader::DoneEvaluations(bool without_standing) {
  return AllNumbers(db_, R"(SELECT e.id
      FROM evaluation AS e LEFT JOIN standing AS v ON v.evaluation = e.id WHERE e.state = 'done'
      AND e.kind != 'rerun' AND (NOT ?1 OR v.evaluation IS NULL) ORDER BY e.id)",
                    without_standing);
}

}  // namespace myograde::server
