// Reading the store while the daemon writes it: connections of their own, each
// reading one consistent state.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

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

// The queries; only inside ReaderPool::Read, where all of them see one state.
// What is asked for by id and is not there is a NotFoundError.
class Reader {
 public:
  explicit Reader(SQLite::Database& db) : db_(db) {}

  absl::StatusOr<ArtefactRow> Artefact(const std::string& hash);
  absl::StatusOr<SubmissionRow> Submission(int64_t id);
  std::vector<SubmissionRow> Submissions(const SubmissionFilter& filter);
  absl::StatusOr<EvaluationRow> Evaluation(int64_t id);
  // Of a submission: the original first.
  std::vector<EvaluationRow> Evaluations(int64_t submission);
  // Every evaluation that has not ended, oldest first.
  std::vector<EvaluationRow> Unfinished();
  std::vector<LeaseRow> Leases(int64_t evaluation);    // by first episode
  std::vector<EpisodeRow> Episodes(int64_t evaluation);  // by index
  std::vector<ReplayRow> Replays(int64_t evaluation);
  EpisodeCounts Counts(int64_t evaluation);
  std::vector<TransitionRow> Transitions(const std::string& entity, int64_t id);
  // The effective config, and the seeds, as canonical JSON.
  absl::StatusOr<std::string> ConfigJson(const std::string& hash);
  absl::StatusOr<std::string> SeedsJson(const std::string& hash);
  // Original evaluations that are done, of ranked submissions under a config.
  std::vector<EvaluationRow> Ranked(const std::string& config);
  // How many such there are under other configs of the same track and profile.
  int64_t RankedElsewhere(const std::string& track, const std::string& profile,
                          const std::string& config);

  // Whether a submission of this team would be refused for its name; the errors are
  // those of Writer::Accept.
  absl::Status CheckTeam(const std::string& team);
  // The name under which the store has a team that is called so; `name` if it has none.
  std::string TeamOf(const std::string& name);

  QuotaUse Quota(const std::string& team, const std::string& track, int64_t now_ms);
  int64_t QuotaDayAt(int64_t now_ms);
  // Newest first; `track` "" is any, `before` an id.
  std::vector<LedgerRow> Ledger(const std::string& team, const std::string& track, int64_t before,
                                int64_t limit);
  // The marks in force, by submission and mark.
  std::map<int64_t, std::map<std::string, MarkRow>> Marks();
  // Every change of the marks of a submission, oldest first.
  std::vector<MarkRow> MarkHistory(int64_t submission);
  // Changes whenever a board may have changed, and only then.
  int64_t BoardChanges();
  // What may rank under a config: done, ranked and original, by submission.
  std::vector<StandingRow> Standings(const std::string& config);
  // The whole store as one document; transfer.h has its form.
  absl::Status Export(const ExportSink& sink) { return ExportRows(db_, sink); }
  std::vector<ArtefactUse> ArtefactUses();
  // Hashes of logs of what has not ended, or is done and official.
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
  // writing; `progress` hears the pages from time to time. The copy is checked.
  absl::Status Backup(const std::string& path,
                      const std::function<void(int64_t done, int64_t total)>& progress);

 private:
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Take();

  const std::string path_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_;  // guarded by mutex_
};

}  // namespace myograde::server
