// The daemon's memory: the one writer of the store. A change is made of
// operations inside one transaction, so that it is there as a whole or not at
// all:
//
//   absl::Status status = store->Write([&](Writer& writer) -> absl::Status {
//     if (auto s = writer.FinishLease(lease, attempt, output, "daemon"); !s.ok()) return s;
//     return writer.EndEvaluation(evaluation, EvaluationState::kDone, "", hash, "daemon");
//   });
//
// After a failure nothing of it is in the store, and the same change may be
// tried again later: an operation that finds its work done already is content.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/rows.h"
#include "server/store/transfer.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

// A submission to accept. Content that the store has already is shared.
struct NewSubmission {
  std::string team;
  std::string artefact;  // must be in the store
  std::string track;
  std::string profile;
  std::string config;          // hash of `config_json`
  std::string config_json;     // the effective track config, canonical
  std::string seeds;           // hash of `seeds_json`
  std::string seeds_json;      // array of numbers, canonical
  int64_t seed_count = 0;
  bool ranked = false;
  std::string grader_json;
  std::vector<std::pair<int64_t, int64_t>> blocks;  // first and last episode of each lease
};

// What a submission must fit into to be accepted.
struct AdmissionRules {
  QuotaLimits quota;
  // An artefact has one ranked evaluation in a config: for each team, or (true)
  // for all teams together.
  bool one_for_everyone = false;
};

// Whose files an artefact's are until somebody asks for it to be graded.
struct NewUpload {
  std::string uploader;     // "uid 1000"
  std::string team;         // "": not known
  bool organiser = false;   // bound by the limits of all together alone
};

// Artefacts whose files are here and that nobody has submitted.
struct UnsubmittedLimits {
  int64_t count = 4000;
  int64_t bytes = int64_t{64} << 30;
  int64_t of_one = 1000;    // of one uploader, and of one team
  int64_t bytes_of_one = int64_t{16} << 30;
  absl::Duration age = absl::Hours(24);  // then their files go
};

// Re-runs that have not ended.
struct RerunLimits {
  int64_t unfinished = 64;     // of those who are no organisers, together
  int64_t of_one = 8;          // asked for by one of them
  int64_t of_a_submission = 2;
  int64_t of_organisers = 256;
};

// The kind of what Writer::Remove takes only if it is still unsubmitted.
inline constexpr char kUploadKind[] = "upload";

struct NewRerun {
  int64_t submission = 0;
  std::string artefact;  // the submission's
  std::string grader_json;
  std::vector<std::pair<int64_t, int64_t>> blocks;
};

struct Accepted {
  int64_t submission = 0;
  int64_t evaluation = 0;
  std::vector<int64_t> leases;  // in the order of the blocks
  // True: nothing is new. The team has this artefact's ranked evaluation
  // already, and `submission` and `evaluation` are that one's; no leases here.
  bool linked = false;
};

// More units for a team, on the store's present day and in total.
struct NewGrant {
  std::string team;
  std::string track;
  Budget budget = Budget::kRanked;
  int64_t amount = 0;
  std::string why;
};

// What became of an episode's row.
struct Recorded {
  bool counted = false;              // false: a row was there already, and stays
  std::vector<std::string> differs;  // if not counted: what is not as in that row
};

// The operations; only inside Store::Write. `who` and `why` go into the audit
// rows. A step that the states do not allow is a FailedPreconditionError.
class Writer {
 public:
  Writer(SQLite::Database& db, int64_t now_ms) : db_(db), now_ms_(now_ms) {}

  // One of several changes that share a transaction: if it fails, or the schema refuses a row
  // of it, nothing of it is there, and the others go on.
  absl::Status Part(const std::function<absl::Status(Writer&)>& change);

  // True if it was not there.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact);
  // Says whose the files of an artefact are that are about to be kept. Does nothing
  // for one that was submitted; what is over a limit is a FailedPreconditionError
  // with the code "quota".
  absl::Status AddUpload(const ArtefactRow& artefact, const NewUpload& upload,
                         const UnsubmittedLimits& limits);
  // NotFoundError if the artefact is not in the store; a damaged row (damage.h) if the config
  // or the seeds are there and are not those given. What is over a quota, a
  // second ranked evaluation of an artefact that is another team's, and a new
  // team whose name looks like another's, is a FailedPreconditionError with the
  // code "quota", "same_artefact" or "look_alike" (ResembledTeam). A name that no
  // new team may have is an InvalidArgumentError. So are those of the other
  // operations that take a team.
  absl::StatusOr<Accepted> Accept(const NewSubmission& submission, const AdmissionRules& rules,
                                  const std::string& who);
  absl::StatusOr<Accepted> AddRerun(const NewRerun& rerun, const std::string& who);
  // Whether `who` may have one more re-run of a submission: FailedPreconditionError
  // with the code "quota" if too many have not ended.
  absl::Status CheckReruns(int64_t submission, const std::string& who, bool organiser,
                           const RerunLimits& limits);

  // pending -> running, as the attempt given (one more than before). Its
  // evaluation, if queued, runs as well.
  absl::Status StartLease(int64_t lease, int64_t attempt, int64_t slot, int64_t deadline_ms,
                          const std::string& who);
  // Keeps the row that is there; if the new one differs, remembers in what.
  absl::StatusOr<Recorded> RecordEpisode(const EpisodeRow& row);
  // running -> done. FailedPreconditionError unless every episode has its row.
  absl::Status FinishLease(int64_t lease, int64_t attempt, const std::string& output_json,
                           const std::string& who);
  // running -> pending: to be played again. `fault`: the grader's, and counted.
  absl::Status ReturnLease(int64_t lease, int64_t attempt, bool fault, const std::string& who,
                           const std::string& why);
  // pending or running -> failed or cancelled. `fault` as above.
  absl::Status EndLease(int64_t lease, LeaseState state, bool fault, const std::string& who,
                        const std::string& why);
  // A row about an evaluation that stays in its state.
  absl::Status NoteEvaluation(int64_t evaluation, const std::string& who, const std::string& why);
  // queued or running -> a final state. FailedPreconditionError while it has
  // leases that have not ended.
  absl::Status EndEvaluation(int64_t evaluation, EvaluationState state, const std::string& reason,
                             const std::string& results_hash, const std::string& who);
  // The same, with all of its leases that have not ended: they are cancelled.
  absl::Status EndWithLeases(int64_t evaluation, EvaluationState state, const std::string& why,
                             const std::string& who);
  // Ends an evaluation whose rows can't be read as grader_error, as far as they can be written:
  // values of a wrong type give way to 0 and "". An error: it stays as it is.
  absl::Status EndUnreadable(int64_t evaluation, const std::string& why, const std::string& who);
  // Evaluations that have not ended, of a submission or of all.
  std::vector<int64_t> OpenEvaluations(std::optional<int64_t> submission);

  // One unit of the budget `failed` for a try that never became a submission.
  absl::Status ChargeFailure(const std::string& team, const std::string& track,
                             const std::string& who, const std::string& why);
  absl::Status Grant(const NewGrant& grant, const std::string& who);
  // Sets or takes back a mark; true if that changed something (with the same
  // reason it does not). NotFoundError if there is no such submission.
  absl::StatusOr<bool> Mark(int64_t submission, const std::string& mark, bool set,
                            const std::string& who, const std::string& why);
  // What a finished evaluation is ranked by; replaces what was there.
  absl::Status SetStanding(int64_t evaluation, const Standing& standing);
  absl::Status DropStandings();
  // The row of a removal of the files of an artefact or of a log (`name` is its hash); false,
  // and no row, if they are needed.
  absl::StatusOr<bool> Remove(const std::string& kind, const std::string& name, int64_t bytes,
                              const std::string& why);
  // Fills an empty store; transfer.h has the errors. What had not ended when it
  // was exported ends as cancelled, as the artefacts' files are not in an export.
  absl::Status Import(const std::string& path, const ExportInfo& info, const std::string& who);

 private:
  absl::StatusOr<LeaseRow> Lease(int64_t lease);
  absl::Status Audit(const char* entity, int64_t id, std::string_view from, std::string_view to,
                     const std::string& who, const std::string& why);
  absl::StatusOr<Accepted> AddEvaluation(
      int64_t submission, bool rerun, const std::string& grader_json,
      const std::vector<std::pair<int64_t, int64_t>>& blocks, const std::string& who);
  absl::Status RunEvaluation(int64_t evaluation, const std::string& who);
  void MendTypes(const char* table, int64_t id);
  void MendBoardState();
  // The ranked evaluation that stands in the way of another; nullopt: none.
  absl::StatusOr<std::optional<Accepted>> FindOfficial(const NewSubmission& submission,
                                                       const AdmissionRules& rules);
  void ChargeFirstEpisode(int64_t evaluation, const std::string& why);
  void SettleCharge(int64_t evaluation, EvaluationState state, const std::string& who);

  SQLite::Database& db_;
  int64_t now_ms_;
};

class Store {
 public:
  // Opens or makes the store at `path`; see connection.h for the errors.
  // `clock` must outlive it. For one thread at a time.
  static absl::StatusOr<std::unique_ptr<Store>> Open(const std::string& path, const Clock& clock);
  ~Store();

  // Runs `change` in one transaction; commits if it returns OkStatus().
  absl::Status Write(const std::function<absl::Status(Writer&)>& change);

  // 32 bytes, made at random with the store: the key of policy seeds under configs of form 1.
  const std::string& policy_secret() const { return policy_secret_; }
  // What could not be read when it was opened, and was made anew.
  const std::optional<Damage>& mended() const { return mended_; }

 private:
  Store(std::string path, std::unique_ptr<SQLite::Database> db, const Clock& clock);
  absl::Status LoadSecret();

  std::string path_;
  std::unique_ptr<SQLite::Database> db_;
  const Clock& clock_;
  std::string policy_secret_;
  std::optional<Damage> mended_;
};

}  // namespace myograde::server
