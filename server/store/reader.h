// Reading the store while the daemon writes it: connections of their own, each
// reading one consistent state.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/rows.h"

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

 private:
  absl::StatusOr<std::unique_ptr<SQLite::Database>> Take();

  const std::string path_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<SQLite::Database>> free_;  // guarded by mutex_
};

}  // namespace myograde::server
