#include "server/store/reader.h"

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"
#include "server/store/connection.h"
#include "server/store/damage.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

// Idle connections kept open between requests; each has a cache of about 1 MiB (OpenForReading).
constexpr size_t kKept = 8;


constexpr char kEvaluationColumns[] =
    "SELECT e.id, e.submission, e.kind, e.first, e.last, e.state, e.reason, e.grader_json, "
    "e.results_hash, e.created_at, e.started_at, e.finished_at, e.config, e.seeds, e.rejudge, "
    "e.repetition, e.source, e.method "
    "FROM evaluation AS e ";

StoredRow EvaluationOf(SQLite::Statement& select, EvaluationRow& evaluation) {
  StoredRow row(select, "evaluation");
  evaluation.id = row.Id(0);
  evaluation.submission = row.Id(1);
  evaluation.kind = row.Named(2, ParseEvaluationKind);
  evaluation.first = row.Number(3, 0, kMaxEpisodes - 1);
  evaluation.last = row.Number(4, evaluation.first, kMaxEpisodes - 1);
  evaluation.state = row.Named(5, ParseEvaluationState);
  evaluation.reason = row.Text(6);
  evaluation.grader_json = row.Object(7);
  evaluation.results_hash = row.TextOr(8);
  evaluation.created_at = row.Time(9);
  evaluation.started_at = row.TimeOr0(10);
  evaluation.finished_at = row.TimeOr0(11);
  if (!select.isColumnNull(12)) evaluation.config = row.Hash(12);
  if (!select.isColumnNull(13)) evaluation.seeds = row.Hash(13);
  if (!select.isColumnNull(14)) {
    evaluation.rejudge = row.Id(14);
    evaluation.repetition = row.Number(15, 1, kMostRepeats);
    evaluation.source = row.Id(16);
    evaluation.method = row.Named(17, ParseRejudgeMethod);
  }
  if (IsFinal(evaluation.state) == select.isColumnNull(11)) {
    row.Fail(5, "its time of ending says otherwise");
  }
  // 0 stands for none wherever it is shown.
  if (IsFinal(evaluation.state) && evaluation.finished_at <= 0) {
    row.Fail(11, "a time after 1970 belongs there");
  }
  return row;
}

StoredRow LeaseOf(SQLite::Statement& select, LeaseRow& lease) {
  StoredRow row(select, "lease");
  lease.id = row.Id(0);
  lease.evaluation = row.Id(12);
  lease.first = row.Number(1, 0, kMaxEpisodes - 1);
  lease.last = row.Number(2, lease.first, kMaxEpisodes - 1);
  lease.state = row.Named(3, ParseLeaseState);
  lease.attempt = row.Number(4, 0, kMany);
  lease.faults = row.Number(5, 0, lease.attempt);
  lease.detail = row.Text(6);
  lease.slot = row.NumberOr(7, 0, kMany, -1);
  lease.started_at = row.TimeOr0(8);
  lease.deadline_at = row.TimeOr0(9);
  lease.finished_at = row.TimeOr0(10);
  if (!select.isColumnNull(11)) lease.output_json = row.Object(11);
  if (IsFinal(lease.state) == select.isColumnNull(10)) {
    row.Fail(3, "its time of ending says otherwise");
  }
  return row;
}

StoredRow EpisodeOf(SQLite::Statement& select, EpisodeRow& episode) {
  StoredRow row(select, "episode",
                absl::StrCat(Shown(select.getColumn(8)), "/", Shown(select.getColumn(0))));
  episode.evaluation = row.Id(8);
  episode.index = row.Number(0, 0, kMaxEpisodes - 1);
  episode.lease = row.Id(1);
  episode.attempt = row.Number(2, 1, kMany);
  episode.seed = static_cast<uint64_t>(row.Number(3, 0, INT64_MAX));
  episode.outcome = row.Named(4, ParseOutcome);
  episode.reason = row.Named(5, ParseFailureReason);
  episode.facts_json = row.Object(6);
  episode.metrics_json = row.Object(7);
  if ((episode.outcome == Outcome::kFailure) != (episode.reason != FailureReason::kNone)) {
    row.Fail(5, "its outcome says otherwise");
  }
  return row;
}

// Content is addressed by its hash, so a mismatch means that it is not what was stored.
absl::StatusOr<std::string> Content(SQLite::Database& db, const char* table, const char* column,
                                    const std::string& hash) {
  Statement select(db, absl::StrCat("SELECT ", column, " FROM ", table, " WHERE hash = ?"), hash);
  if (!select.executeStep()) {
    return DamagedRow({table, hash, "it is missing, and other rows name it"});
  }
  StoredRow row(select, table, hash);
  std::string text = row.Text(0);
  if (row.ok() && Sha256Hex(text) != hash) row.Fail("its content has another hash");
  if (!row.ok()) return row.status();
  return text;
}

}  // namespace

const BoardState& Reader::Board() {
  if (state_ == nullptr) {
    followed_ = fold_->Follow(db_);
    state_ = followed_.get();
  }
  return *state_;
}

absl::StatusOr<EvaluationRow> Reader::Evaluation(int64_t id) {
  return FirstOf<EvaluationRow>(
      Statement(db_, absl::StrCat(kEvaluationColumns, "WHERE e.id = ?"), id), EvaluationOf,
      absl::NotFoundError(absl::StrCat("there is no evaluation ", id)));
}

absl::StatusOr<std::vector<EvaluationRow>> Reader::Evaluations(int64_t submission) {
  auto rows = AllOf<EvaluationRow>(
      Statement(db_,
                absl::StrCat(kEvaluationColumns,
                             "WHERE e.submission = ? ORDER BY e.kind != 'original', e.id"),
                submission),
      EvaluationOf);
  if (rows.ok() && (rows->empty() || rows->front().kind != EvaluationKind::kOriginal)) {
    return DamagedRow({"submission", absl::StrCat(submission),
                       "it has no evaluation, or none that is its original one"});
  }
  return rows;
}

absl::StatusOr<std::vector<EvaluationRow>> Reader::EvaluationsOfRejudge(int64_t rejudge) {
  return AllOf<EvaluationRow>(
      Statement(db_,
                absl::StrCat(kEvaluationColumns,
                             "WHERE e.rejudge = ? ORDER BY e.submission, e.repetition"),
                rejudge),
      EvaluationOf);
}

absl::StatusOr<EvaluationRow> Reader::Original(int64_t submission) {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> rows, Evaluations(submission));
  return std::move(rows.front());
}

UnfinishedRows Reader::Unfinished() {
  // Anything not in a final state has not ended, including rows with an invalid state.
  Statement select(db_, absl::StrCat(kEvaluationColumns,
                                     "WHERE e.finished_at IS NULL OR (e.state IN ('done', "
                                     "'failed', 'cancelled', 'grader_error')) IS NOT TRUE "
                                     "ORDER BY e.id"));
  UnfinishedRows found;
  while (select.executeStep()) {
    EvaluationRow row;
    const StoredRow read = EvaluationOf(select, row);
    if (read.ok()) {
      found.rows.push_back(std::move(row));
    } else {
      found.damaged.push_back(*read.damage());
    }
  }
  return found;
}

absl::StatusOr<std::vector<LeaseRow>> Reader::Leases(int64_t evaluation) {
  return AllOf<LeaseRow>(Statement(db_, R"(SELECT id, first, last, state,
      attempt, faults, detail, slot, started_at, deadline_at, finished_at, output_json, evaluation
      FROM lease WHERE evaluation = ? ORDER BY first)",
                                   evaluation),
                         LeaseOf);
}

absl::StatusOr<std::vector<EpisodeRow>> Reader::Episodes(int64_t evaluation) {
  return AllOf<EpisodeRow>(Statement(db_, R"(SELECT idx, lease, attempt, seed, outcome, reason,
      facts_json, metrics_json, evaluation FROM episode WHERE evaluation = ? ORDER BY idx)",
                                     evaluation),
                           EpisodeOf);
}

absl::StatusOr<std::vector<RepeatRow>> Reader::Repeats(int64_t evaluation) {
  const auto parse = [](SQLite::Statement& select, RepeatRow& replay) {
    StoredRow row(select, "replay");
    replay.index = row.Number(1, 0, kMaxEpisodes - 1);
    replay.attempt = row.Number(2, 1, kMany);
    replay.differs = row.Strings(3);
    return row;
  };
  return AllOf<RepeatRow>(Statement(db_, R"(SELECT id, idx, attempt, differs_json
      FROM replay WHERE evaluation = ? ORDER BY idx, attempt)",
                                    evaluation),
                          parse);
}

EpisodeCounts Reader::Counts(int64_t evaluation, bool ended_leases) {
  return AllRows<EpisodeCounts, 4>(Statement(db_, R"(SELECT count(*),
      ifnull(sum(outcome = 'success'), 0), ifnull(sum(outcome = 'failure'), 0),
      count(*) - ifnull(sum(outcome IN ('success', 'failure')), 0) FROM episode WHERE evaluation = ?1
      AND (?2 = 0 OR lease NOT IN (SELECT id FROM lease WHERE evaluation = ?1
      AND finished_at IS NULL)))",
                                             evaluation, ended_leases))
      .front();
}

absl::StatusOr<std::vector<TransitionRow>> Reader::Transitions(const std::string& entity,
                                                               int64_t id) {
  const auto parse = [](SQLite::Statement& select, TransitionRow& transition) {
    StoredRow row(select, "transition");
    transition.at = row.Time(1);
    transition.entity_id = row.Number(2, INT64_MIN, INT64_MAX);
    row.TextsInto(3, {&transition.entity, &transition.from, &transition.to, &transition.who,
                      &transition.why});
    return row;
  };
  return AllOf<TransitionRow>(
      Statement(db_, R"(SELECT id, at, entity_id, entity, from_state, to_state, who, why
          FROM transition WHERE entity = ? AND entity_id = ? ORDER BY id)",
                entity, id),
      parse);
}

absl::StatusOr<std::string> Reader::ConfigJson(const std::string& hash) {
  return Content(db_, "config", "effective_json", hash);
}

absl::StatusOr<std::string> Reader::SeedsJson(const std::string& hash) {
  return Content(db_, "seed_list", "seeds_json", hash);
}

ReaderPool::ReaderPool(std::string path) : path_(std::move(path)) {}
ReaderPool::~ReaderPool() = default;

absl::StatusOr<std::unique_ptr<SQLite::Database>> ReaderPool::Take() {
  {
    const MutexLock lock(mutex_);
    if (!free_.empty()) {
      std::unique_ptr<SQLite::Database> db = std::move(free_.back());
      free_.pop_back();
      return db;
    }
  }
  return OpenForReading(path_);
}

absl::Status ReaderPool::Read(const std::function<absl::Status(Reader&)>& body) {
  absl::StatusOr<std::unique_ptr<SQLite::Database>> db = Take();
  if (IsCorruptStore(db.status()) && corrupt_observer_ != nullptr) corrupt_observer_(db.status());
  if (!db.ok()) return db.status();
  const absl::Duration begin = SystemClock().Monotonic();
  absl::Status answer;
  const absl::Status status = GuardSqlite(path_, [&] {
    SQLite::Transaction transaction(**db);  // deferred: all queries see one state
    Reader reader(**db, fold_);
    answer = body(reader);
    transaction.commit();
    return absl::OkStatus();
  });
  if (observer_ != nullptr) observer_(SystemClock().Monotonic() - begin);
  if (IsCorruptStore(status) && corrupt_observer_ != nullptr) corrupt_observer_(status);
  if (!status.ok()) return status;  // close the connection, as its state is unknown
  const MutexLock lock(mutex_);
  if (free_.size() < kKept) free_.push_back(*std::move(db));
  return answer;
}

absl::Status ReaderPool::Backup(const std::string& path,
                                const std::function<void(int64_t, int64_t)>& progress,
                                const std::function<void(const std::string&)>& damaged) {
  ASSIGN_OR_RETURN(std::unique_ptr<SQLite::Database> source, OpenForReading(path_));
  return GuardSqlite(path, [&] { return CopyDatabase(*source, path_, path, progress, damaged); });
}

}  // namespace myograde::server
