// Which config each board had, and what stands on a board as of a moment.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

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

constexpr char kStandingColumns[] =
    "SELECT s.id, e.id, t.name, a.name, v.aggregate_json, v.successes, v.episodes, v.names, "
    "v.numbers, s.team_id, s.artefact, e.state, e.finished_at, t.banned ";
constexpr char kStandingNames[] =
    "LEFT JOIN team AS o ON o.id = s.team_id "
    "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) "
    "LEFT JOIN artefact AS a ON a.hash = s.artefact ";

// A candidate row, and what is known beside it.
struct Candidate {
  StandingRow standing;
  EvaluationState state = EvaluationState::kQueued;
  bool banned = false;
};

StoredRow CandidateOf(SQLite::Statement& select, Candidate& candidate) {
  StoredRow row(select, "submission");
  StandingRow& standing = candidate.standing;
  standing.submission = row.Id(0);
  if (select.isColumnNull(1)) row.Fail("it has no evaluation");
  standing.evaluation = row.IdOr0(1);
  row.Joined("evaluation", 1);
  candidate.state = row.Named(11, ParseEvaluationState);
  standing.finished_at = row.Time(12);
  row.Joined("team", 9);
  standing.team = row.Text(2);
  candidate.banned = row.Flag(13);
  row.Joined("artefact", 10);
  standing.artefact_name = row.Text(3);
  if (row.ok()) ReadView(select, standing.standing);
  return row;
}

// A rejudge of rules to a config counts as of a moment if the latest of its events says so. Has the
// parameter ?2, the moment.
constexpr char kIsApplied[] =
    "(SELECT v.event FROM rejudge_event AS v WHERE v.rejudge = r.id AND v.at < ?2 "
    "ORDER BY v.id DESC LIMIT 1) = 'applied'";

// For json_each().
std::string JsonArray(const std::vector<int64_t>& numbers) {
  return absl::StrCat("[", absl::StrJoin(numbers, ","), "]");
}

StoredRow BoardConfigOf(SQLite::Statement& select, BoardConfigRow& config) {
  StoredRow row(select, "board_config");
  config.id = row.Id(0);
  config.at = row.Time(1);
  row.TextsInto(2, {&config.board.phase, &config.board.track, &config.board.profile});
  config.config = row.Hash(5);
  config.rejudge = row.IdOr0(6);
  config.who = row.Text(7);
  if (config.rejudge != 0) {
    row.Joined("rejudge", 8);
    config.from_config = row.Hash(8);
  }
  return row;
}

constexpr char kBoardConfigColumns[] =
    "SELECT b.id, b.at, b.phase, b.track, b.profile, b.config, b.rejudge, b.who, r.from_config "
    "FROM board_config AS b LEFT JOIN rejudge AS r ON r.id = b.rejudge ";

}  // namespace

std::optional<std::string> NewestBoardConfig(SQLite::Database& db, const BoardName& board) {
  Statement last(db, R"(SELECT config
      FROM board_config WHERE phase = ? AND track = ? AND profile = ? ORDER BY id DESC LIMIT 1)",
                 board.phase, board.track, board.profile);
  if (!last.executeStep()) return std::nullopt;
  return last.getColumn(0).getString();
}

absl::StatusOr<bool> Writer::SetBoardConfig(const NewBoardConfig& change, const std::string& who) {
  const BoardName& board = change.board;
  if (change.rejudge == 0 && NewestBoardConfig(db_, board) == change.config) return false;
  if (!change.config_json.empty() && Sha256Hex(change.config_json) != change.config) {
    return absl::InternalError("a board's config has another hash than is said");
  }
  if (!change.config_json.empty()) {
    Run(db_, "INSERT OR IGNORE INTO config VALUES (?, ?, ?, ?, ?)", change.config, board.track,
        board.profile, change.config_json, now_ms_);
  }
  if (!AnyRow(db_, "SELECT 1 FROM config WHERE hash = ?", change.config)) {
    return absl::FailedPreconditionError(
        absl::StrCat("the store has no config ", change.config, " for a board to have"));
  }
  MendBoardState();
  Run(db_, R"(INSERT INTO board_config (at, phase, track, profile, config, rejudge, who)
      VALUES (?, ?, ?, ?, ?, nullif(?, 0), ?))",
      now_ms_, board.phase, board.track, board.profile, change.config, change.rejudge, who);
  AppendEntry(db_, kConfigEntry, db_.getLastInsertRowid());
  return true;
}

absl::StatusOr<std::vector<BoardConfigRow>> Reader::BoardConfigs(
    const std::optional<BoardName>& board) {
  const BoardName wanted = board.value_or(BoardName());
  return AllOf<BoardConfigRow>(
      Statement(db_,
                absl::StrCat(kBoardConfigColumns,
                             "WHERE ?1 OR (b.phase = ?2 AND b.track = ?3 AND b.profile = ?4) "
                             "ORDER BY b.id"),
                !board.has_value(), wanted.phase, wanted.track, wanted.profile),
      BoardConfigOf);
}

absl::StatusOr<std::string> Reader::ConfigAt(const BoardName& board, int64_t before_ms) {
  Statement row(db_,
                absl::StrCat(kBoardConfigColumns,
                             "WHERE b.phase = ? AND b.track = ? AND b.profile = ? "
                             "AND b.at < ? ORDER BY b.id DESC LIMIT 1"),
                board.phase, board.track, board.profile, before_ms);
  if (row.executeStep()) {
    BoardConfigRow config;
    if (const StoredRow read = BoardConfigOf(row, config); !read.ok()) return read.status();
    return config.config;
  }
  // `accepted_at` grows with the id, up to a clock that was set back.
  return FirstText(db_, R"(SELECT s.config FROM config AS c CROSS JOIN submission AS s ON s.config
      = c.hash WHERE c.track = ?2 AND c.profile = ?3 AND s.ranked = 1 AND s.phase = ?1 ORDER BY
      s.accepted_at < ?4 DESC, CASE WHEN s.accepted_at < ?4 THEN -s.id ELSE s.id END LIMIT 1)",
                   board.phase, board.track, board.profile, before_ms);
}

Listed<StandingRow> Reader::Standings(const std::string& config) {
  Statement select(
      db_,
      absl::StrCat(kStandingColumns, "FROM submission AS s ", kStandingNames,
                   "LEFT JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' "
                   "LEFT JOIN standing AS v ON v.evaluation = e.id "
                   "WHERE s.config = ? AND s.ranked = 1 AND (e.state IN ('queued', 'running', "
                   "'failed', 'cancelled', 'grader_error')) IS NOT TRUE ORDER BY s.id"),
      config);
  Listed<StandingRow> listed;
  while (select.executeStep()) {
    Candidate candidate;
    const StoredRow row = CandidateOf(select, candidate);
    if (!row.ok()) {
      listed.damaged.push_back(*row.damage());
    } else if (!candidate.banned) {
      listed.rows.push_back(std::move(candidate.standing));
    }
  }
  return listed;
}

std::vector<int64_t> Reader::AppliedRejudges(const std::string& to_config,
                                             const BoardMoment& moment) {
  std::vector<int64_t> rejudges = AllNumbers(
      db_,
      absl::StrCat("SELECT r.id FROM rejudge AS r WHERE r.to_config = ?1 AND "
                   "r.purpose = 'rules' AND r.id != ?3 AND ",
                   kIsApplied,
                   " ORDER BY (SELECT max(v.id) FROM rejudge_event AS v WHERE v.rejudge = r.id "
                   "AND v.at < ?2 AND v.event = 'applied')"),
      to_config, moment.results_before_ms(), moment.assumed_rejudge);
  if (AnyRow(db_, "SELECT 1 FROM rejudge WHERE id = ? AND to_config = ?", moment.assumed_rejudge,
             to_config)) {
    rejudges.push_back(moment.assumed_rejudge);
  }
  return rejudges;
}

std::map<int64_t, int64_t> EvaluationsInForce(
    const std::vector<EndedResult>& originals,
    const std::vector<std::vector<EndedResult>>& rejudges) {
  std::map<int64_t, int64_t> in_force;
  const auto apply = [&](const std::vector<EndedResult>& results) {
    for (const EndedResult& result : results) {
      in_force.erase(result.submission);
      if (result.done) in_force.emplace(result.submission, result.evaluation);
    }
  };
  apply(originals);
  for (const std::vector<EndedResult>& results : rejudges) apply(results);
  return in_force;
}

std::set<int64_t> StandingChoices(const std::vector<TeamChoice>& choices) {
  std::map<int64_t, int64_t> by_team;
  for (const TeamChoice& choice : choices) {
    if (choice.of_board || choice.rejudged) by_team[choice.team] = choice.submission;
  }
  std::set<int64_t> chosen;
  for (const auto& [team, submission] : by_team) chosen.insert(submission);
  return chosen;
}

InForce Reader::StandingsInForce(const std::string& config, const BoardMoment& moment) {
  InForce found;
  std::map<int64_t, StandingRow> rows;  // by evaluation
  std::vector<EndedResult> originals;
  std::vector<std::vector<EndedResult>> rejudged;
  // Until it has ended, the result before stands. A row of damage stands for its submission's.
  const auto add = [&](StandingRow row, bool done, std::vector<EndedResult>& results) {
    if (row.finished_at >= moment.results_before_ms()) {
      found.withheld |= row.finished_at < moment.before_ms;
      return;
    }
    results.push_back({row.submission, row.evaluation, done});
    if (done) rows.emplace(row.evaluation, std::move(row));
  };
  Listed<StandingRow> own = Standings(config);
  found.damaged = std::move(own.damaged);
  for (StandingRow& row : own.rows) add(std::move(row), /*done=*/true, originals);
  for (const int64_t rejudge : AppliedRejudges(config, moment)) {
    std::vector<EndedResult>& results = rejudged.emplace_back();
    Statement select(db_,
                     absl::StrCat(kStandingColumns,
                                  "FROM rejudge_item AS i "
                                  "LEFT JOIN submission AS s ON s.id = i.submission ",
                                  kStandingNames,
                                  "LEFT JOIN evaluation AS e ON e.id = i.evaluation "
                                  "LEFT JOIN standing AS v ON v.evaluation = e.id "
                                  "WHERE i.rejudge = ? AND i.repetition = 1 AND "
                                  "(e.state IN ('queued', 'running')) IS NOT TRUE "
                                  "ORDER BY i.submission"),
                     rejudge);
    while (select.executeStep()) {
      Candidate candidate;
      const StoredRow row = CandidateOf(select, candidate);
      if (!row.ok()) {
        found.damaged.push_back(*row.damage());
        results.push_back({candidate.standing.submission, 0, /*done=*/false});
        continue;
      }
      candidate.standing.rejudge = rejudge;
      add(std::move(candidate.standing),
          !candidate.banned && candidate.state == EvaluationState::kDone, results);
    }
  }
  for (const auto& [submission, evaluation] : EvaluationsInForce(originals, rejudged)) {
    found.rows.push_back(std::move(rows.at(evaluation)));
  }
  return found;
}

int64_t Reader::BoardChangedAt(const std::string& config, const std::string& phase,
                               const BoardMoment& moment) {
  const int64_t at =
      FirstNumber(db_, R"(WITH own (id, team) AS (SELECT id, team_id FROM submission WHERE config
          = ?1 AND ranked = 1 UNION SELECT s.id, s.team_id FROM rejudge AS r JOIN rejudge_item AS i
          ON i.rejudge = r.id JOIN submission AS s ON s.id = i.submission WHERE r.to_config = ?1)
          SELECT max(at) FROM (SELECT max(e.finished_at) AS at FROM own JOIN evaluation AS e ON
          e.submission = own.id WHERE e.kind != 'rerun' AND e.state = 'done' AND e.finished_at < ?2
          UNION ALL SELECT max(m.at) FROM own JOIN mark AS m ON m.submission = own.id WHERE
          m.at < ?3 UNION ALL SELECT max(c.at) FROM own JOIN choice AS c ON c.submission = own.id
          WHERE c.at < ?2 UNION ALL SELECT max(v.at) FROM rejudge AS r JOIN rejudge_event AS v
          ON v.rejudge = r.id WHERE ?1 IN (r.from_config, r.to_config) AND v.event != 'created'
          AND v.at < ?2 UNION ALL SELECT max(t.at) FROM team_event AS t WHERE t.event != 'created'
          AND t.at < ?3 AND t.team_id IN (SELECT team FROM own) UNION ALL SELECT max(at)
          FROM board_config WHERE config = ?1 AND at < ?2 UNION ALL SELECT max(at) FROM phase_event
          WHERE phase = ?4 AND ?4 != '' AND event IN ('published', 'revealed') AND at < ?3))",
                  config, moment.results_before_ms(), moment.before_ms, phase);
  return std::max<int64_t>(at, 0);
}

std::set<int64_t> Reader::Choices(const std::string& config, const BoardMoment& moment) {
  Statement select(db_, R"(SELECT ifnull(t.merged_into, t.id), c.submission, s.config = ?1, EXISTS
      (SELECT 1 FROM rejudge_item AS i JOIN evaluation AS e ON e.id = i.evaluation
      WHERE i.submission = s.id AND i.repetition = 1 AND e.finished_at < ?2
      AND i.rejudge IN (SELECT value FROM json_each(?3))) FROM choice AS c JOIN submission AS s
      ON s.id = c.submission JOIN team AS t ON t.id = c.team_id WHERE c.at < ?2 ORDER BY c.id)",
                   config, moment.results_before_ms(), JsonArray(AppliedRejudges(config, moment)));
  std::vector<TeamChoice> choices;
  while (select.executeStep()) {
    choices.push_back({select.getColumn(0).getInt64(), select.getColumn(1).getInt64(),
                       select.getColumn(2).getInt() != 0, select.getColumn(3).getInt() != 0});
  }
  return StandingChoices(choices);
}

std::vector<OtherConfig> Reader::OtherConfigs(const BoardName& board, const std::string& config,
                                              const BoardMoment& moment) {
  // Of each config, the submissions that have a result of their own or by a rejudge.
  Statement select(
      db_,
      absl::StrCat(
          "WITH stands (config, submission) AS ("
          "SELECT c.hash, s.id FROM config AS c CROSS JOIN submission AS s ON s.config = c.hash "
          "AND s.ranked = 1 JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original' "
          "WHERE c.track = ?4 AND c.profile = ?5 AND c.hash != ?1 AND s.phase = ?3 AND "
          "e.state = 'done' AND e.finished_at < ?2 "
          "UNION SELECT r.to_config, i.submission FROM rejudge AS r CROSS JOIN rejudge_item AS i "
          "ON i.rejudge = r.id AND i.repetition = 1 JOIN evaluation AS e ON e.id = i.evaluation "
          "WHERE r.phase = ?3 AND r.track = ?4 AND r.profile = ?5 AND r.to_config != ?1 AND "
          "r.purpose = 'rules' AND e.state = 'done' AND e.finished_at < ?2 AND ",
          kIsApplied,
          ") SELECT x.config, count(*), count(DISTINCT ifnull(t.merged_into, t.id)), "
          "min(s.accepted_at), max(s.accepted_at) FROM stands AS x "
          "JOIN submission AS s ON s.id = x.submission JOIN team AS t ON t.id = s.team_id "
          "GROUP BY x.config ORDER BY min(s.accepted_at), x.config"),
      config, moment.results_before_ms(), board.phase, board.track, board.profile);
  return AllRows<OtherConfig, 5>(std::move(select));
}

int64_t Reader::RankedElsewhere(const BoardName& board, const std::string& config,
                                const BoardMoment& moment) {
  return FirstNumber(db_, R"(SELECT count(*) FROM config AS c CROSS JOIN submission AS s ON s.config
      = c.hash AND s.ranked = 1 JOIN evaluation AS e ON e.submission = s.id AND e.kind = 'original'
      WHERE c.track = ?4 AND c.profile = ?5 AND c.hash != ?1 AND s.phase = ?3 AND e.state = 'done'
      AND e.finished_at < ?2 AND NOT EXISTS (SELECT 1 FROM rejudge_item AS i WHERE i.submission
      = s.id AND i.repetition = 1 AND i.rejudge IN (SELECT value FROM json_each(?6))))",
                     config, moment.results_before_ms(), board.phase, board.track, board.profile,
                     JsonArray(AppliedRejudges(config, moment)));
}

std::vector<std::string> Reader::ConfigsLike(const std::string& prefix, bool of_open_rejudges) {
  return AllTexts(db_, R"(SELECT c.hash FROM config AS c WHERE c.hash >= ?1 AND c.hash < ?1 || 'g'
      AND (EXISTS (SELECT 1 FROM submission AS s WHERE s.config = c.hash AND s.ranked = 1) OR EXISTS
      (SELECT 1 FROM board_config AS b WHERE b.config = c.hash) OR (?2 AND EXISTS
      (SELECT 1 FROM rejudge AS r WHERE r.to_config = c.hash))) ORDER BY c.hash)",
                  prefix, of_open_rejudges);
}

std::vector<std::string> Reader::GradersOf(const std::vector<int64_t>& evaluations) {
  std::vector<std::string> graders;
  for (const int64_t evaluation : evaluations) {
    graders.push_back(
        FirstText(db_, "SELECT grader_json FROM evaluation WHERE id = ?", evaluation));
  }
  return graders;
}

RejudgeSight Reader::RejudgeOfEvaluation(int64_t evaluation) {
  Statement select(db_, R"(SELECT i.rejudge, EXISTS (SELECT 1 FROM rejudge_event AS v
      WHERE v.rejudge = i.rejudge AND v.event = 'applied'), EXISTS (SELECT 1 FROM rejudge AS q
      JOIN phase_event AS p ON p.phase = q.phase AND p.event = 'revealed' WHERE q.id = i.rejudge
      AND q.purpose = 'seeds' AND q.phase != '') FROM rejudge_item AS i WHERE i.evaluation = ?)",
                   evaluation);
  if (!select.executeStep()) return {};
  return {select.getColumn(0).getInt64(), select.getColumn(1).getInt() != 0,
          select.getColumn(2).getInt() != 0};
}

absl::Status Reader::CheckStandingRows(int64_t submission) {
  ASSIGN_OR_RETURN(const SubmissionRow row, Submission(submission));
  absl::Status status = Team(row.team).status();
  status.Update(MarkHistory(submission).status());
  Statement items(db_, "SELECT evaluation, rejudge FROM rejudge_item WHERE submission = ?",
                  submission);
  while (status.ok() && items.executeStep()) {
    status = RejudgeItemOf(items.getColumn(0).getInt64()).status();
    status.Update(Rejudge(items.getColumn(1).getInt64()).status());
    status.Update(RejudgeEvents(items.getColumn(1).getInt64()).status());
  }
  return status;
}

}  // namespace myograde::server
