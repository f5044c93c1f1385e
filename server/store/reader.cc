#include "server/store/reader.h"

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "protocol/tracks/registry.h"
#include "server/store/artefact_options.h"
#include "server/store/connection.h"
#include "server/store/damage.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

// Idle connections kept open between requests; each has a cache of about 1 MiB (OpenForReading).
constexpr size_t kKept = 8;


constexpr char kSubmissionColumns[] =
    "SELECT s.id, t.name, s.artefact, a.name, s.track, s.profile, s.config, s.seeds, s.ranked, "
    "s.accepted_at, s.team_id, s.accepted_by, s.phase, s.extra_observations FROM submission AS s "
    "LEFT JOIN team AS o ON o.id = s.team_id "
    "LEFT JOIN team AS t ON t.id = ifnull(o.merged_into, o.id) "
    "LEFT JOIN artefact AS a ON a.hash = s.artefact ";

constexpr char kEvaluationColumns[] =
    "SELECT e.id, e.submission, e.kind, e.first, e.last, e.state, e.reason, e.grader_json, "
    "e.results_hash, e.created_at, e.started_at, e.finished_at, e.config, e.seeds "
    "FROM evaluation AS e ";

StoredRow SubmissionOf(SQLite::Statement& select, SubmissionRow& submission) {
  StoredRow row(select, "submission", Shown(select.getColumn(0)));
  submission.id = row.Number(0, 1, INT64_MAX);
  submission.artefact = row.Hash(2);
  submission.track = row.Text(4);
  submission.profile = row.Text(5);
  submission.config = row.Hash(6);
  submission.seeds = row.Hash(7);
  submission.ranked = row.Flag(8);
  submission.accepted_at = row.Time(9);
  submission.accepted_by = row.Text(11);
  submission.phase = row.Text(12);
  submission.extra_observations = row.Flag(13);
  row.Joined("team", 10);
  submission.team = row.Text(1);
  row.Joined("artefact", 2);
  submission.artefact_name = row.Text(3);
  return row;
}

StoredRow EvaluationOf(SQLite::Statement& select, EvaluationRow& evaluation) {
  StoredRow row(select, "evaluation", Shown(select.getColumn(0)));
  evaluation.id = row.Number(0, 1, INT64_MAX);
  evaluation.submission = row.Number(1, 1, INT64_MAX);
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
  StoredRow row(select, "lease", Shown(select.getColumn(0)));
  lease.id = row.Number(0, 1, INT64_MAX);
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
                absl::StrCat(episode.evaluation, "/", Shown(select.getColumn(0))));
  episode.index = row.Number(0, 0, kMaxEpisodes - 1);
  episode.lease = row.Number(1, 1, INT64_MAX);
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
  SQLite::Statement select(
      db, absl::StrCat("SELECT ", column, " FROM ", table, " WHERE hash = ?"));
  select.bind(1, hash);
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

absl::StatusOr<ArtefactRow> Reader::Artefact(const std::string& hash) {
  SQLite::Statement select(db_, "SELECT name, command_json, runtimes_json, bytes, files, "
                                "environment_json, options_json FROM artefact WHERE hash = ?");
  select.bind(1, hash);
  if (!select.executeStep()) {
    return UnknownArtefact(hash);
  }
  StoredRow row(select, "artefact", hash);
  ArtefactRow artefact;
  artefact.hash = hash;
  artefact.name = row.Text(0);
  artefact.command = row.Strings(1);
  artefact.runtimes = row.Strings(2);
  artefact.bytes = row.Number(3, 0, INT64_MAX);
  artefact.files = row.Number(4, 0, INT64_MAX);
  artefact.environment = row.Texts(5);
  ReadArtefactOptions(row, 6, artefact);
  if (artefact.command.empty()) row.Fail(1, "a program belongs there");
  if (!row.ok()) return row.status();
  return artefact;
}

absl::StatusOr<SubmissionRow> Reader::Submission(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kSubmissionColumns, "WHERE s.id = ?"));
  select.bind(1, id);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", id));
  }
  SubmissionRow submission;
  if (const StoredRow row = SubmissionOf(select, submission); !row.ok()) return row.status();
  return submission;
}

Listed<SubmissionRow> Reader::Submissions(const SubmissionFilter& filter) {
  SQLite::Statement select(
      db_, absl::StrCat(kSubmissionColumns,
                        "WHERE s.id < ?1 AND (?2 = '' OR t.name = ?2) AND (?3 = '' OR s.track = ?3)"
                        " AND (?4 = '' OR s.profile = ?4) AND (?5 = '' OR EXISTS (SELECT 1 FROM "
                        "evaluation AS e WHERE e.submission = s.id AND e.kind = 'original' AND "
                        "e.state = ?5)) AND (?7 = '' OR t.name IN (SELECT value FROM json_each(?7)))"
                        " AND (?8 = '' OR s.phase = ?8) ORDER BY s.id DESC LIMIT ?6"));
  SQLite::bind(select, filter.before, filter.team, filter.track, filter.profile,
               filter.state ? std::string(EvaluationStateName(*filter.state)) : std::string(),
               filter.limit,
               filter.teams ? CanonicalJson(nlohmann::json(*filter.teams)) : std::string(),
               filter.phase);
  return ListOf<SubmissionRow>(select, {}, SubmissionOf);
}

absl::StatusOr<EvaluationRow> Reader::Evaluation(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kEvaluationColumns, "WHERE e.id = ?"));
  select.bind(1, id);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", id));
  }
  EvaluationRow evaluation;
  if (const StoredRow row = EvaluationOf(select, evaluation); !row.ok()) return row.status();
  return evaluation;
}

absl::StatusOr<std::vector<EvaluationRow>> Reader::Evaluations(int64_t submission) {
  SQLite::Statement select(
      db_, absl::StrCat(kEvaluationColumns,
                        "WHERE e.submission = ? ORDER BY e.kind != 'original', e.id"));
  select.bind(1, submission);
  auto rows = AllOf<EvaluationRow>(select, {}, EvaluationOf);
  if (rows.ok() && (rows->empty() || rows->front().kind != EvaluationKind::kOriginal)) {
    return DamagedRow({"submission", absl::StrCat(submission),
                       "it has no evaluation, or none that is its original one"});
  }
  return rows;
}

absl::StatusOr<EvaluationRow> Reader::Original(int64_t submission) {
  ASSIGN_OR_RETURN(std::vector<EvaluationRow> rows, Evaluations(submission));
  return std::move(rows.front());
}

Listed<EvaluationRow> Reader::Unfinished() {
  // Anything not in a final state has not ended, including rows with an invalid state.
  SQLite::Statement select(
      db_, absl::StrCat(kEvaluationColumns, "WHERE e.finished_at IS NULL OR (e.state IN ('done', "
                        "'failed', 'cancelled', 'grader_error')) IS NOT TRUE ORDER BY e.id"));
  return ListOf<EvaluationRow>(select, {}, EvaluationOf);
}

absl::StatusOr<std::vector<LeaseRow>> Reader::Leases(int64_t evaluation) {
  SQLite::Statement select(
      db_, "SELECT id, first, last, state, attempt, faults, detail, slot, started_at, "
           "deadline_at, finished_at, output_json FROM lease WHERE evaluation = ? ORDER BY first");
  select.bind(1, evaluation);
  LeaseRow empty;
  empty.evaluation = evaluation;
  return AllOf(select, empty, LeaseOf);
}

absl::StatusOr<std::vector<EpisodeRow>> Reader::Episodes(int64_t evaluation) {
  SQLite::Statement select(db_, "SELECT idx, lease, attempt, seed, outcome, reason, facts_json, "
                                "metrics_json FROM episode WHERE evaluation = ? ORDER BY idx");
  select.bind(1, evaluation);
  EpisodeRow empty;
  empty.evaluation = evaluation;
  return AllOf(select, empty, EpisodeOf);
}

absl::StatusOr<std::vector<RepeatRow>> Reader::Repeats(int64_t evaluation) {
  SQLite::Statement select(db_, "SELECT idx, attempt, differs_json, id FROM replay "
                                "WHERE evaluation = ? ORDER BY idx, attempt");
  select.bind(1, evaluation);
  return AllOf<RepeatRow>(select, {}, [](SQLite::Statement& read, RepeatRow& replay) {
    StoredRow row(read, "replay", Shown(read.getColumn(3)));
    replay.index = row.Number(0, 0, kMaxEpisodes - 1);
    replay.attempt = row.Number(1, 1, kMany);
    replay.differs = row.Strings(2);
    return row;
  });
}

EpisodeCounts Reader::Counts(int64_t evaluation, bool ended_leases) {
  SQLite::Statement select(
      db_, "SELECT count(*), ifnull(sum(outcome = 'success'), 0), "
           "ifnull(sum(outcome = 'failure'), 0) FROM episode WHERE evaluation = ?1 AND (?2 = 0 OR "
           "lease NOT IN (SELECT id FROM lease WHERE evaluation = ?1 AND finished_at IS NULL))");
  SQLite::bind(select, evaluation, ended_leases ? 1 : 0);
  select.executeStep();
  EpisodeCounts counts;
  counts.done = select.getColumn(0).getInt64();
  counts.success = select.getColumn(1).getInt64();
  counts.failure = select.getColumn(2).getInt64();
  counts.fault = counts.done - counts.success - counts.failure;
  return counts;
}

absl::StatusOr<std::vector<TransitionRow>> Reader::Transitions(const std::string& entity,
                                                               int64_t id) {
  SQLite::Statement select(db_, "SELECT at, from_state, to_state, who, why, id FROM transition "
                                "WHERE entity = ? AND entity_id = ? ORDER BY id");
  SQLite::bind(select, entity, id);
  TransitionRow empty;
  empty.entity = entity;
  empty.entity_id = id;
  return AllOf(select, empty, [](SQLite::Statement& read, TransitionRow& transition) {
    StoredRow row(read, "transition", Shown(read.getColumn(5)));
    transition.at = row.Time(0);
    transition.from = row.Text(1);
    transition.to = row.Text(2);
    transition.who = row.Text(3);
    transition.why = row.Text(4);
    return row;
  });
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
    Reader reader(**db);
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

}  // namespace myograde::server
