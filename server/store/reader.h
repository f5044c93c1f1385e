// Reading the store while the daemon writes it: connections of their own, each
// reading one consistent state.
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

#include "protocol/base/mutex.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/rows.h"
#include "server/store/transfer.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

// Which submissions to list, newest first. Empty text: any.
struct SubmissionFilter {
  std::string team = "";
  std::string track = "";
  std::string profile = "";
  std::optional<EvaluationState> state = std::nullopt;  // of the original evaluation
  int64_t before = INT64_MAX;            // only ids below
  int64_t limit = 100;
};

// Of a refusal with the code "look_alike": the team that the name looks like, which
// is the organiser's to know. "": none.
std::string ResembledTeam(const absl::Status& status);

// The marks in force, by submission and mark.
struct MarksInForce {
  std::map<int64_t, std::map<std::string, MarkRow>> by_submission;
  std::map<int64_t, Damage> damaged;  // of submissions whose marks can't be known; 0: nor whose
};

// The queries; only inside ReaderPool::Read, where all of them see one state.
// What is asked for by id and is not there is a NotFoundError. A row that can't be read is
// told as damage.h has it: what is one answer fails with it, lists go on without it.
class Reader {
 public:
  explicit Reader(SQLite::Database& db) : db_(db) {}

  absl::StatusOr<ArtefactRow> Artefact(const std::string& hash);
  absl::StatusOr<SubmissionRow> Submission(int64_t id);
  Listed<SubmissionRow> Submissions(const SubmissionFilter& filter);
  absl::StatusOr<EvaluationRow> Evaluation(int64_t id);
  // Of a submission: the original first. Never empty.
  absl::StatusOr<std::vector<EvaluationRow>> Evaluations(int64_t submission);
  absl::StatusOr<EvaluationRow> Original(int64_t submission);
  // Every evaluation that has not ended, oldest first. The keys of the damaged ones are ids.
  Listed<EvaluationRow> Unfinished();
  absl::StatusOr<std::vector<LeaseRow>> Leases(int64_t evaluation);    // by first episode
  absl::StatusOr<std::vector<EpisodeRow>> Episodes(int64_t evaluation);  // by index
  absl::StatusOr<std::vector<RepeatRow>> Repeats(int64_t evaluation);
  EpisodeCounts Counts(int64_t evaluation);
  absl::StatusOr<std::vector<TransitionRow>> Transitions(const std::string& entity, int64_t id);
  // The effective config, and the seeds, as canonical JSON whose hash is the one asked for.
  absl::StatusOr<std::string> ConfigJson(const std::string& hash);
  absl::StatusOr<std::string> SeedsJson(const std::string& hash);
  // How many original evaluations of ranked submissions are done under other configs of the
  // same track and profile.
  int64_t RankedElsewhere(const std::string& track, const std::string& profile,
                          const std::string& config);

  // Whether a submission of this team would be refused for its name; the errors are
  // those of Writer::Accept.
  absl::Status CheckTeam(const std::string& team);
  // The name under which the store has a team that is called so; `name` if it has none.
  std::string TeamOf(const std::string& name);

  QuotaUse Quota(const std::string& team, const std::string& track, int64_t now_ms);
  int64_t QuotaDayAt(int64_t now_ms);
  // The budget that a submission is charged to, and was not given back; "" if none is.
  std::string ChargedBudget(int64_t submission);
  // Newest first; `track` "" is any, `before` an id.
  Listed<LedgerRow> Ledger(const std::string& team, const std::string& track, int64_t before,
                           int64_t limit);
  MarksInForce Marks();
  // Every change of the marks of a submission, oldest first.
  absl::StatusOr<std::vector<MarkRow>> MarkHistory(int64_t submission);
  // Changes whenever a board may have changed, and only then.
  int64_t BoardChanges();
  // What may rank under a config: done, ranked and original, by submission. What is damaged in
  // the view itself is as if the view lacked it.
  Listed<StandingRow> Standings(const std::string& config);
  // The whole store as one document; transfer.h has its form.
  absl::Status Export(const ExportSink& sink) { return ExportRows(db_, sink); }
  std::vector<ArtefactUse> ArtefactUses();
  // What nobody has submitted, the oldest first.
  std::vector<UploadRow> Uploads();
  // Hashes of logs of what has not ended, or is done and ranked.
  std::set<std::string> NeededLogs();
  // Evaluations that are done and have no standing, or all that are done.
  std::vector<int64_t> DoneEvaluations(bool without_standing);

 private:
  SQLite::Database& db_;
};

// Connections for readers; safe to use from any thread.
class ReaderPool {
 public:
  explicit ReaderPool(std::string path);
  ~ReaderPool();

  // Runs `body` on a free connection, opening one if there is none.
  absl::Status Read(const std::function<absl::Status(Reader&)>& body);
  // Writes the store as it is now into a new file at `path`, while others go on
  // writing; `progress` hears the pages from time to time. The copy is checked: it is as
  // whole as a file, and `damaged` hears of the rows in it that are not.
  absl::Status Backup(const std::string& path,
                      const std::function<void(int64_t done, int64_t total)>& progress,
                      const std::function<void(const std::string& what)>& damaged);

 private:
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Take();

  const std::string path_;
  Mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
