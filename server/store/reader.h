// Reads the store while the daemon writes it, on separate connections that each see one consistent
// state.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "protocol/base/status_macros.h"
#include "server/store/damage.h"
#include "server/store/deliveries.h"
#include "server/store/quota.h"
#include "server/store/journal.h"
#include "server/store/rejudges.h"
#include "server/store/rows.h"
#include "server/store/submissions.h"
#include "server/store/transfer.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

// Which submissions to list, newest first. Empty strings match any.
struct SubmissionFilter {
  std::string team = "";
  std::string track = "";
  std::string profile = "";
  std::string phase = "";
  std::optional<EvaluationState> state = std::nullopt;  // of the original evaluation
  std::optional<std::set<std::string>> teams = std::nullopt;  // only theirs
  int64_t before = INT64_MAX;            // only ids below
  int64_t limit = 100;
};

// The team that the name of a "look_alike" error resembles, for the organiser. "" for any other
// status.
std::string ResembledTeam(const absl::Status& status);

// Where an episode is that a log is of.
struct LoggedEpisode {
  int64_t evaluation = 0;
  int64_t index = 0;
  int64_t lease = 0;
  uint64_t seed = 0;
};

struct UnfinishedRows {
  std::vector<EvaluationRow> rows;
  std::vector<Damage> damaged;  // keyed by id
};

struct EndedEvaluation {
  int64_t evaluation = 0;
  int64_t finished_at = 0;
};

// The queries, only inside ReaderPool::Read, where all of them see one state. Looking up a missing
// id is a NotFoundError. Unreadable rows are reported as in damage.h: a query for a single answer
// fails, lists leave the row out and log it.
class Reader {
 public:
  // On a connection whose journal `fold` follows.
  Reader(SQLite::Database& db, BoardFold& fold) : db_(db), fold_(&fold) {}
  // Where somebody has the state of the journal.
  Reader(SQLite::Database& db, const BoardState& state) : db_(db), state_(&state) {}

  // What the journal says: marks, choices, phases, teams, configs and rejudges, and what counts on boards.
  const BoardState& Board();

  absl::StatusOr<ArtefactRow> Artefact(const std::string& hash);
  // Whether `who` may submit an artefact for a team: they uploaded it themselves, or the team holds it.
  bool MaySubmitArtefact(const std::string& hash, const std::string& who, const std::string& team);
  bool UploadedArtefact(const std::string& hash, const std::string& who);
  // Somebody uploaded it for the team, or the team submitted it.
  bool TeamHoldsArtefact(const std::string& hash, const std::string& team);
  absl::StatusOr<SubmissionRow> Submission(int64_t id);
  Listed<SubmissionRow> Submissions(const SubmissionFilter& filter);
  absl::StatusOr<EvaluationRow> Evaluation(int64_t id);
  // A submission's evaluations, the original first. Never empty.
  absl::StatusOr<std::vector<EvaluationRow>> Evaluations(int64_t submission);
  absl::StatusOr<EvaluationRow> Original(int64_t submission);
  // Artefacts that are held back (Writer::WithHold), sorted: as of the grader that played them last.
  std::vector<std::string> HeldBack();

  // Every evaluation that has not ended, oldest first.
  UnfinishedRows Unfinished();
  absl::StatusOr<std::vector<LeaseRow>> Leases(int64_t evaluation);    // by first episode
  // The attempts of its leases that have ended, by lease and attempt.
  absl::StatusOr<std::vector<LeaseRunRow>> LeaseRunsOf(int64_t evaluation);
  // By name.
  Listed<DrainedNodeRow> DrainedNodes();
  absl::StatusOr<std::vector<EpisodeRow>> Episodes(int64_t evaluation);  // by index
  absl::StatusOr<std::vector<RepeatRow>> Repeats(int64_t evaluation);
  // `ended_leases`: only episodes of leases that have ended, so that nothing tells how far one is.
  EpisodeCounts Counts(int64_t evaluation, bool ended_leases = false);
  absl::StatusOr<std::vector<TransitionRow>> Transitions(const std::string& entity, int64_t id);
  // The effective config, and the seeds, as canonical JSON with the given hash.
  absl::StatusOr<std::string> ConfigJson(const std::string& hash);
  absl::StatusOr<std::string> SeedsJson(const std::string& hash);

  // Whether a submission by this team would be rejected for its name, or because it is banned;
  // errors as of Writer::Accept.
  absl::Status CheckTeam(const std::string& team);
  // The stored name of the team called `name`, now or formerly; `name` itself if there is none.
  std::string TeamOf(const std::string& name);
  // The teams that a person belongs to: "uid 1000". An unreadable membership is none.
  std::set<std::string> TeamsOf(const std::string& person);
  // The team called `name`, now or formerly: never one that was merged into another.
  absl::StatusOr<TeamRow> Team(const std::string& name);
  // Newest first, with those that were merged; `before` is an id.
  Listed<TeamRow> Teams(int64_t before = INT64_MAX, int64_t limit = INT64_MAX);
  // By person.
  Listed<MemberRow> Members(const std::string& team);
  // Oldest first, with those of the teams that were merged into it.
  std::vector<TeamEventRow> TeamEvents(const std::string& team);
  // Whether they can be merged; errors as of Writer::MergeTeams.
  absl::Status CheckMerge(const std::string& team, const std::string& into);
  // The number of submissions, with those of the teams that were merged into it.
  int64_t SubmissionsOf(const std::string& team);
  // By the SHA-256 of its text, whether it is valid or not.
  absl::StatusOr<TokenRow> TokenByHash(const std::string& sha256);
  absl::StatusOr<TokenRow> Token(int64_t id);
  // Newest first; `before` is an id.
  Listed<TokenRow> Tokens(int64_t before = INT64_MAX, int64_t limit = INT64_MAX);

  // Whose it is: today's name of the team. NotFoundError if there is no such submission or
  // evaluation, or if nobody can tell whose it is.
  absl::StatusOr<std::string> TeamOfSubmission(int64_t id);
  absl::StatusOr<std::string> TeamOfEvaluation(int64_t id);
  // The teams one of whose episodes has the log with this SHA-256.
  std::set<std::string> TeamsOfLog(const std::string& sha256);
  // The phases of those episodes; "": of none.
  std::set<std::string> PhasesOfLog(const std::string& sha256);

  // The first episode with this log. NotFoundError: there is none.
  absl::StatusOr<LoggedEpisode> EpisodeOfLog(const std::string& sha256);
  // Evaluations that ended as done after `after_ms`: the last `limit` of them, oldest first.
  std::vector<EndedEvaluation> DoneSince(int64_t after_ms, int64_t limit);
  // When the last one ended, in ms since 1970; 0: none has.
  int64_t LastEnd();

  // Newest first. `kind` "" matches any; `before` is an id.
  Listed<AccessEventRow> AccessEvents(const std::string& kind, int64_t before, int64_t limit);

  // What Writer::Once would return without asking to accept; nullopt: it would ask.
  absl::StatusOr<std::optional<Accepted>> FindRequest(const std::string& who,
                                                      const RequestKey& key);

  // `phase` "": of the track itself.
  QuotaUse Quota(const std::string& team, const std::string& track, int64_t now_ms,
                 const std::string& phase = "");
  int64_t QuotaDayAt(int64_t now_ms);
  // The budget that a submission is charged to; "" if none, or if it was refunded.
  std::string ChargedBudget(int64_t submission);
  // Newest first. `track` "" matches any; `before` is an id.
  Listed<LedgerRow> Ledger(const std::string& team, const std::string& track, int64_t before,
                           int64_t limit);
  // NotFoundError: it has none; otherwise as Writer::PhaseSecret.
  absl::StatusOr<std::string> PhaseSecret(const std::string& phase);
  // Why Writer::PhaseSecret would refuse.
  absl::Status CheckPhaseSecret(const std::string& phase, const std::string& challenge);
  // Phases with submissions, by name.
  absl::StatusOr<std::vector<PhaseUse>> PhasesInUse();
  // The keys of a table that is keyed by hash: "artefact", "config", "seed_list".
  std::vector<std::string> Hashes(const std::string& table);
  // The whole store as one document, in transfer.h's format.
  absl::Status Export(const ExportSink& sink) { return ExportRows(db_, sink); }
  std::vector<ArtefactUse> ArtefactUses();
  // Uploads that nobody has submitted, oldest first.
  std::vector<UploadRow> Uploads();
  // Hashes of the logs of evaluations that have not ended, or are done and ranked.
  std::set<std::string> NeededLogs();
  // Hashes of the logs of practice episodes, except those that an evaluation which may rank needs too.
  std::set<std::string> PracticeLogs();
  // What finished evaluations are ranked by, as far as the view has it and it can be read.
  std::map<int64_t, Standing> Standings(const std::vector<int64_t>& evaluations);
  // Evaluations that are done: all, or those without a standing.
  std::vector<int64_t> DoneEvaluations(bool without_standing);

  // The public record: the index that the next entry gets, entries from an index on, and the entry
  // with an evaluation's result (NotFoundError: there is none).
  int64_t RecordSize();
  Listed<RecordRow> Record(int64_t from, int64_t limit);
  absl::StatusOr<RecordRow> GradedEntry(int64_t evaluation);

  // Rejudges (rejudges.h).
  absl::StatusOr<RejudgeRow> Rejudge(int64_t id);
  // By submission and repetition.
  absl::StatusOr<std::vector<EvaluationRow>> EvaluationsOfRejudge(int64_t rejudge);
  absl::StatusOr<RejudgeProgress> ProgressOf(const RejudgeRow& rejudge);
  // The items that it lacks, first repetitions first; none for purpose kSeeds.
  std::vector<RejudgeCandidate> MissingItems(const RejudgeRow& rejudge);
  // The same before it is created.
  std::vector<RejudgeCandidate> CandidatesFor(const NewRejudge& rejudge);
  // The submissions whose repetitions that have ended as done or failed differ, with every episode
  // that does.
  absl::StatusOr<std::vector<Unrepeatable>> UnrepeatableOf(int64_t rejudge);
  // The builds that evaluations are of, as stored; "" for one that is missing.
  std::vector<std::string> GradersOf(const std::vector<int64_t>& evaluations);
  // The oldest event that waits for a webhook. NotFoundError: none does; a damaged row (damage.h).
  absl::StatusOr<DeliveryRow> NextDelivery(const std::string& webhook);
  // Its id, also if it is damaged; 0: none waits.
  int64_t NextDeliveryId(const std::string& webhook);
  // Newest first. `webhook` "" matches any; `before` is an id.
  Listed<DeliveryRow> Deliveries(const std::string& webhook, int64_t before, int64_t limit);
  // Of each webhook with rows, by name.
  std::vector<DeliveryCounts> CountDeliveries();
  // How many submissions' own evaluations are in each state; "unreadable" counts damaged ones.
  std::map<std::string, int64_t> SubmissionsByState();
  // The text of the JSON object with an episode's details, by index, of those that have some.
  absl::StatusOr<std::map<int64_t, std::string>> EpisodeDetails(int64_t evaluation);

 private:
  std::set<std::string> LogsWhere(const std::string& condition);

  SQLite::Database& db_;
  BoardFold* fold_ = nullptr;
  std::shared_ptr<const BoardState> followed_;
  const BoardState* state_ = nullptr;
};

// Connections for readers; safe to use from any thread.
class ReaderPool {
 public:
  explicit ReaderPool(std::string path);
  ~ReaderPool();

  // Is told how long each Read took. Before anybody reads.
  void SetObserver(std::function<void(absl::Duration)> observer) {
    observer_ = std::move(observer);
  }

  // Is told of each Read that found the store corrupt (damage.h), on any thread. Before anybody reads.
  void SetCorruptObserver(std::function<void(const absl::Status&)> observer) {
    corrupt_observer_ = std::move(observer);
  }

  // Runs `body` on a free connection, or opens one.
  absl::Status Read(const std::function<absl::Status(Reader&)>& body);
  // The same for a body that gives a value.
  template <typename T>
  absl::StatusOr<T> Read(const std::function<absl::StatusOr<T>(Reader&)>& body) {
    absl::StatusOr<T> value = absl::UnknownError("");
    RETURN_IF_ERROR(Read([&](Reader& reader) {
      value = body(reader);
      return value.status();
    }));
    return value;
  }
  // Writes a copy of the current store to a new file at `path` while others go on writing; calls
  // `progress` with page counts from time to time. The copy is checked as a file; damaged rows in
  // it are passed to `damaged`.
  absl::Status Backup(const std::string& path,
                      const std::function<void(int64_t done, int64_t total)>& progress,
                      const std::function<void(const std::string& what)>& damaged);

 private:
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Take();

  const std::string path_;
  BoardFold fold_;
  std::function<void(absl::Duration)> observer_;
  std::function<void(const absl::Status&)> corrupt_observer_;
  Mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
