#include "server/store/reader.h"

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "server/store/connection.h"

namespace myograde::server {
namespace {

// Connections that are kept open between requests; each has a cache of some 2 MiB.
constexpr size_t kKept = 16;

constexpr char kSubmissionColumns[] =
    "SELECT s.id, t.name, s.artefact, a.name, s.track, s.profile, s.config, s.seeds, s.ranked, "
    "s.accepted_at FROM submission AS s JOIN team AS t ON t.id = s.team_id "
    "JOIN artefact AS a ON a.hash = s.artefact ";

constexpr char kEvaluationColumns[] =
    "SELECT e.id, e.submission, e.kind, e.first, e.last, e.state, e.reason, e.grader_json, "
    "e.results_hash, e.created_at, e.started_at, e.finished_at FROM evaluation AS e ";

std::vector<std::string> StringsOf(const std::string& json) {
  const nlohmann::json array = nlohmann::json::parse(json, nullptr, false);
  return array.is_array() ? array.get<std::vector<std::string>>() : std::vector<std::string>();
}

SubmissionRow SubmissionOf(SQLite::Statement& row) {
  SubmissionRow submission;
  submission.id = row.getColumn(0).getInt64();
  submission.team = row.getColumn(1).getString();
  submission.artefact = row.getColumn(2).getString();
  submission.artefact_name = row.getColumn(3).getString();
  submission.track = row.getColumn(4).getString();
  submission.profile = row.getColumn(5).getString();
  submission.config = row.getColumn(6).getString();
  submission.seeds = row.getColumn(7).getString();
  submission.ranked = row.getColumn(8).getInt() != 0;
  submission.accepted_at = row.getColumn(9).getInt64();
  return submission;
}

// NULL columns read as 0 and "".
EvaluationRow EvaluationOf(SQLite::Statement& row) {
  EvaluationRow evaluation;
  evaluation.id = row.getColumn(0).getInt64();
  evaluation.submission = row.getColumn(1).getInt64();
  evaluation.rerun = row.getColumn(2).getString() == "rerun";
  evaluation.first = row.getColumn(3).getInt64();
  evaluation.last = row.getColumn(4).getInt64();
  evaluation.state = *ParseEvaluationState(row.getColumn(5).getString());
  evaluation.reason = row.getColumn(6).getString();
  evaluation.grader_json = row.getColumn(7).getString();
  evaluation.results_hash = row.getColumn(8).getString();
  evaluation.created_at = row.getColumn(9).getInt64();
  evaluation.started_at = row.getColumn(10).getInt64();
  evaluation.finished_at = row.getColumn(11).getInt64();
  return evaluation;
}

std::vector<EvaluationRow> AllEvaluations(SQLite::Statement& select) {
  std::vector<EvaluationRow> rows;
  while (select.executeStep()) rows.push_back(EvaluationOf(select));
  return rows;
}

}  // namespace

absl::StatusOr<ArtefactRow> Reader::Artefact(const std::string& hash) {
  SQLite::Statement select(db_, "SELECT name, command_json, runtimes_json, bytes, files "
                                "FROM artefact WHERE hash = ?");
  select.bind(1, hash);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no artefact ", hash, "; upload it first"));
  }
  ArtefactRow row;
  row.hash = hash;
  row.name = select.getColumn(0).getString();
  row.command = StringsOf(select.getColumn(1).getString());
  row.runtimes = StringsOf(select.getColumn(2).getString());
  row.bytes = select.getColumn(3).getInt64();
  row.files = select.getColumn(4).getInt64();
  return row;
}

absl::StatusOr<SubmissionRow> Reader::Submission(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kSubmissionColumns, "WHERE s.id = ?"));
  select.bind(1, id);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no submission ", id));
  }
  return SubmissionOf(select);
}

std::vector<SubmissionRow> Reader::Submissions(const SubmissionFilter& filter) {
  SQLite::Statement select(
      db_, absl::StrCat(kSubmissionColumns,
                        "WHERE s.id < ?1 AND (?2 = '' OR t.name = ?2) AND (?3 = '' OR s.track = ?3)"
                        " AND (?4 = '' OR s.profile = ?4) AND (?5 = '' OR EXISTS (SELECT 1 FROM "
                        "evaluation AS e WHERE e.submission = s.id AND e.kind = 'original' AND "
                        "e.state = ?5)) ORDER BY s.id DESC LIMIT ?6"));
  SQLite::bind(select, filter.before, filter.team, filter.track, filter.profile,
               filter.state ? std::string(EvaluationStateName(*filter.state)) : std::string(),
               filter.limit);
  std::vector<SubmissionRow> rows;
  while (select.executeStep()) rows.push_back(SubmissionOf(select));
  return rows;
}

absl::StatusOr<EvaluationRow> Reader::Evaluation(int64_t id) {
  SQLite::Statement select(db_, absl::StrCat(kEvaluationColumns, "WHERE e.id = ?"));
  select.bind(1, id);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no evaluation ", id));
  }
  return EvaluationOf(select);
}

std::vector<EvaluationRow> Reader::Evaluations(int64_t submission) {
  SQLite::Statement select(
      db_, absl::StrCat(kEvaluationColumns, "WHERE e.submission = ? ORDER BY e.id"));
  select.bind(1, submission);
  return AllEvaluations(select);
}

std::vector<EvaluationRow> Reader::Unfinished() {
  SQLite::Statement select(
      db_, absl::StrCat(kEvaluationColumns, "WHERE e.finished_at IS NULL ORDER BY e.id"));
  return AllEvaluations(select);
}

std::vector<LeaseRow> Reader::Leases(int64_t evaluation) {
  SQLite::Statement select(
      db_, "SELECT id, first, last, state, attempt, faults, detail, ifnull(slot, -1), started_at, "
           "deadline_at, finished_at, output_json FROM lease WHERE evaluation = ? ORDER BY first");
  select.bind(1, evaluation);
  std::vector<LeaseRow> rows;
  while (select.executeStep()) {
    LeaseRow row;
    row.id = select.getColumn(0).getInt64();
    row.evaluation = evaluation;
    row.first = select.getColumn(1).getInt64();
    row.last = select.getColumn(2).getInt64();
    row.state = *ParseLeaseState(select.getColumn(3).getString());
    row.attempt = select.getColumn(4).getInt64();
    row.faults = select.getColumn(5).getInt64();
    row.detail = select.getColumn(6).getString();
    row.slot = select.getColumn(7).getInt64();
    row.started_at = select.getColumn(8).getInt64();
    row.deadline_at = select.getColumn(9).getInt64();
    row.finished_at = select.getColumn(10).getInt64();
    row.output_json = select.getColumn(11).getString();
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<EpisodeRow> Reader::Episodes(int64_t evaluation) {
  SQLite::Statement select(db_, "SELECT idx, lease, attempt, seed, outcome, reason, facts_json, "
                                "metrics_json FROM episode WHERE evaluation = ? ORDER BY idx");
  select.bind(1, evaluation);
  std::vector<EpisodeRow> rows;
  while (select.executeStep()) {
    EpisodeRow row;
    row.evaluation = evaluation;
    row.index = select.getColumn(0).getInt64();
    row.lease = select.getColumn(1).getInt64();
    row.attempt = select.getColumn(2).getInt64();
    row.seed = static_cast<uint64_t>(select.getColumn(3).getInt64());
    row.outcome = *ParseOutcome(select.getColumn(4).getString());
    row.reason = *ParseFailureReason(select.getColumn(5).getString());
    row.facts_json = select.getColumn(6).getString();
    row.metrics_json = select.getColumn(7).getString();
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<ReplayRow> Reader::Replays(int64_t evaluation) {
  SQLite::Statement select(db_, "SELECT idx, attempt, differs_json FROM replay "
                                "WHERE evaluation = ? ORDER BY idx, attempt");
  select.bind(1, evaluation);
  std::vector<ReplayRow> rows;
  while (select.executeStep()) {
    rows.push_back({select.getColumn(0).getInt64(), select.getColumn(1).getInt64(),
                    StringsOf(select.getColumn(2).getString())});
  }
  return rows;
}

EpisodeCounts Reader::Counts(int64_t evaluation) {
  SQLite::Statement select(
      db_, "SELECT count(*), ifnull(sum(outcome = 'success'), 0), "
           "ifnull(sum(outcome = 'failure'), 0) FROM episode WHERE evaluation = ?");
  select.bind(1, evaluation);
  select.executeStep();
  EpisodeCounts counts;
  counts.done = select.getColumn(0).getInt64();
  counts.success = select.getColumn(1).getInt64();
  counts.failure = select.getColumn(2).getInt64();
  counts.fault = counts.done - counts.success - counts.failure;
  return counts;
}

std::vector<TransitionRow> Reader::Transitions(const std::string& entity, int64_t id) {
  SQLite::Statement select(db_, "SELECT at, from_state, to_state, who, why FROM transition "
                                "WHERE entity = ? AND entity_id = ? ORDER BY id");
  SQLite::bind(select, entity, id);
  std::vector<TransitionRow> rows;
  while (select.executeStep()) {
    rows.push_back({select.getColumn(0).getInt64(), entity, id, select.getColumn(1).getString(),
                    select.getColumn(2).getString(), select.getColumn(3).getString(),
                    select.getColumn(4).getString()});
  }
  return rows;
}

absl::StatusOr<std::string> Reader::ConfigJson(const std::string& hash) {
  SQLite::Statement select(db_, "SELECT effective_json FROM config WHERE hash = ?");
  select.bind(1, hash);
  if (!select.executeStep()) return absl::NotFoundError(absl::StrCat("there is no config ", hash));
  return select.getColumn(0).getString();
}

absl::StatusOr<std::string> Reader::SeedsJson(const std::string& hash) {
  SQLite::Statement select(db_, "SELECT seeds_json FROM seed_list WHERE hash = ?");
  select.bind(1, hash);
  if (!select.executeStep()) {
    return absl::NotFoundError(absl::StrCat("there is no seed list ", hash));
  }
  return select.getColumn(0).getString();
}

std::vector<EvaluationRow> Reader::Ranked(const std::string& config) {
  SQLite::Statement select(
      db_, absl::StrCat(kEvaluationColumns,
                        "JOIN submission AS s ON s.id = e.submission WHERE s.config = ? AND "
                        "s.ranked = 1 AND e.kind = 'original' AND e.state = 'done' "
                        "ORDER BY e.submission"));
  select.bind(1, config);
  return AllEvaluations(select);
}

int64_t Reader::RankedElsewhere(const std::string& track, const std::string& profile,
                                const std::string& config) {
  SQLite::Statement select(
      db_, "SELECT count(*) FROM evaluation AS e JOIN submission AS s ON s.id = e.submission "
           "WHERE s.track = ? AND s.profile = ? AND s.config != ? AND s.ranked = 1 AND "
           "e.kind = 'original' AND e.state = 'done'");
  SQLite::bind(select, track, profile, config);
  select.executeStep();
  return select.getColumn(0).getInt64();
}

ReaderPool::ReaderPool(std::string path) : path_(std::move(path)) {}
ReaderPool::~ReaderPool() = default;

absl::StatusOr<std::unique_ptr<SQLite::Database>> ReaderPool::Take() {
  {
    const std::lock_guard lock(mutex_);
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
  if (!db.ok()) return db.status();
  absl::Status answer;
  const absl::Status status = GuardSqlite(path_, [&] {
    SQLite::Transaction transaction(**db);  // deferred: one state for all of the queries
    Reader reader(**db);
    answer = body(reader);
    transaction.commit();
    return absl::OkStatus();
  });
  if (!status.ok()) return status;  // the connection is closed, as its state is not known
  const std::lock_guard lock(mutex_);
  if (free_.size() < kKept) free_.push_back(*std::move(db));
  return answer;
}

}  // namespace myograde::server
