// The daemon's persistent state, and its only writer. A change runs operations inside one
// transaction, so it is applied as a whole or not at all:
//
//   absl::Status status = store->Write([&](Writer& writer) -> absl::Status {
//     if (auto s = writer.FinishLease(lease, attempt, output, "daemon"); !s.ok()) return s;
//     return writer.EndEvaluation(evaluation, EvaluationState::kDone, "", hash, "daemon");
//   });
//
// A failed change leaves nothing in the store and may be tried again later: an operation whose
// effect is already there succeeds.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/store/damage.h"
#include "server/store/deliveries.h"
#include "server/store/migration.h"
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

class Reader;

// Different kinds of denied requests that have rows of their own, for each UTC day.
inline constexpr int64_t kMostDenialsOfADay = 1000;

// The kind of an artefact that Writer::Remove removes only if it is still unsubmitted.
inline constexpr char kUploadKind[] = "upload";
inline constexpr char kPracticeLogKind[] = "practice log";

// Extra units for a team, for the store's current day and in total.
struct NewGrant {
  std::string team;
  std::string track;
  Budget budget = Budget::kRanked;
  int64_t amount = 0;
  std::string why;
  std::string phase = "";  // "": the track itself
};

// A bearer token to add.
struct NewToken {
  std::string hash;  // SHA-256 of its text
  std::string role;  // "participant", "organiser", "operator"
  std::string team;  // of a participant; else ""
  std::string label;
  int64_t expires_at = 0;  // 0: never
};

// The config that a board has from now on.
struct NewBoardConfig {
  BoardName board;
  std::string config;            // hash
  std::string config_json = "";  // canonical; "": the store has it
  int64_t rejudge = 0;           // whose act it is; 0: the config files changed
};

// The result of recording an episode.
struct Recorded {
  bool counted = false;              // false: a row was already there, and stays
  std::vector<std::string> differs;  // if not counted: in what the new row differs
};

// The operations, only inside Store::Write. `who` and `why` go into the audit rows. A transition
// that the states do not allow is a FailedPreconditionError.
class Writer {
 public:
  // `subscriptions`: who is told of what is written; nullptr: nobody.
  // `board` follows the journal.
  Writer(SQLite::Database& db, int64_t now_ms, BoardState& board,
         const Subscriptions* subscriptions = nullptr)
      : db_(db), now_ms_(now_ms), board_(board), subscriptions_(subscriptions) {}

  // What the journal says, with what this change has added. Valid until more is added.
  const BoardState& Board();

  // One of several changes that share a transaction: if it fails, or the schema rejects one of its
  // rows, all of it is rolled back and the others go on.
  absl::Status Part(const std::function<absl::Status(Writer&)>& change);

  // True if it is new.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact);
  // Records who uploaded an artefact whose files are here or about to be kept, and for which team. Only
  // one that was never submitted counts against the limits. FailedPreconditionError with the code "quota" if over a limit.
  absl::Status AddUpload(const ArtefactRow& artefact, const NewUpload& upload,
                         const UnsubmittedLimits& limits);
  // NotFoundError if the artefact is not in the store; a damaged row (damage.h) if the stored
  // config or seeds are not those given. FailedPreconditionError with the code "quota" if over a
  // quota, "same_artefact" for a second ranked evaluation of another team's artefact, "banned" for a
  // banned team, "look_alike" for a new team whose name looks like another's (ResembledTeam),
  // "paused" if all submissions or those to the phase are paused, "phase_revealed" if its seeds were
  // revealed; submission.closed.
  // InvalidArgumentError for a name
  // that no new team may have. Other operations that take a team have the same name errors.
  absl::StatusOr<Accepted> Accept(const NewSubmission& submission, const AdmissionRules& rules,
                                  const std::string& who);
  absl::StatusOr<Accepted> AddRerun(const NewRerun& rerun, const std::string& who);
  // Runs `accept` if `who` has not sent this key before, and keeps what it accepted; otherwise
  // returns what was accepted then. Errors of `accept`, which keep nothing, and of FindRequestKey.
  absl::StatusOr<Accepted> Once(const std::string& who, const RequestKey& key,
                                const std::function<absl::StatusOr<Accepted>()>& accept);
  // `why` an evaluation ends by the grader's fault; says so too if that holds its artefact back: if
  // the last kFaultsToHold evaluations of it by this grader ended so. Call it before EndEvaluation.
  std::string WithHold(int64_t evaluation, const std::string& why);
  // Charges an original evaluation that is about to be cancelled, if a lease of it has begun: whoever
  // may not see its episodes might have learned something of them by then.
  void ChargeBegun(int64_t evaluation);
  // Whether `who` may have one more re-run of a submission: FailedPreconditionError with the code
  // "quota" if too many have not ended, "banned" if its team is, or kHeldBackCode.
  absl::Status CheckReruns(int64_t submission, const std::string& who, bool organiser,
                           const RerunLimits& limits);

  // pending -> running, as the given attempt (one more than before). A queued evaluation starts
  // running too.
  absl::Status StartLease(int64_t lease, int64_t attempt, int64_t slot, int64_t deadline_ms,
                          const std::string& who);
  // Keeps an existing row; if the new one differs, records in what.
  absl::StatusOr<Recorded> RecordEpisode(const EpisodeRow& row);
  // running -> done. FailedPreconditionError unless every episode has its row.
  absl::Status FinishLease(int64_t lease, int64_t attempt, const std::string& output_json,
                           const std::string& who);
  // running -> pending, for a retry. `fault`: a grader fault, which is counted.
  absl::Status ReturnLease(int64_t lease, int64_t attempt, bool fault, const std::string& who,
                           const std::string& why);
  // pending or running -> failed or cancelled. `fault` as above.
  absl::Status EndLease(int64_t lease, LeaseState state, bool fault, const std::string& who,
                        const std::string& why);
  // Where an attempt of a lease ran and what it used, once it has ended; `ended_at` 0: now. What the
  // store has of that attempt already stays. CPU time and energy that no attempt can have used are
  // stored as the nearest that one can.
  absl::Status RecordLeaseRun(const LeaseRunRow& run);
  // A node of a cluster gets no leases until it is admitted; the reason in force is the latest.
  // Admitting a node that is not drained changes nothing. `node` is not "".
  absl::Status DrainNode(const std::string& node, const std::string& why, const std::string& who);
  absl::Status AdmitNode(const std::string& node, const std::string& who);
  // Adds an audit row for an evaluation without changing its state.
  absl::Status NoteEvaluation(int64_t evaluation, const std::string& who, const std::string& why);
  // queued or running -> a final state. FailedPreconditionError while any of its leases has not
  // ended.
  absl::Status EndEvaluation(int64_t evaluation, EvaluationState state, const std::string& reason,
                             const std::string& results_hash, const std::string& who);
  // The same, and cancels its leases that have not ended.
  absl::Status EndWithLeases(int64_t evaluation, EvaluationState state, const std::string& why,
                             const std::string& who);
  // Ends an evaluation with unreadable rows as grader_error, as far as they can be written: values
  // of a wrong type become 0 and "". An error: it stays as it is.
  absl::Status EndUnreadable(int64_t evaluation, const std::string& why, const std::string& who);
  // The evaluations that a cancel of the submission ends: those of its original one and, if
  // `reruns`, its re-runs that have not ended. Rejudges end by DropRejudge alone.
  std::vector<int64_t> OpenEvaluationsOf(int64_t submission, bool reruns);

  // Charges one unit of the budget `failed` for an attempt that never became a submission.
  absl::Status ChargeFailure(const std::string& team, const std::string& track,
                             const std::string& who, const std::string& why);
  absl::Status Grant(const NewGrant& grant, const std::string& who);

  // Teams and their members. Every name may also be a former one, or that of a team that was merged
  // into the one meant. NotFoundError: there is no such team. "True" means that it changed anything.
  //
  // The stored name. FailedPreconditionError if there is such a team; otherwise the name errors of
  // Accept.
  absl::StatusOr<std::string> CreateTeam(const std::string& team, const std::string& who,
                                         const std::string& why);
  // Makes `person` the first member of a team, which is created if there is none. Does nothing for
  // a member. FailedPreconditionError with the code "forbidden" if the team has or had other
  // members, tokens, or submissions of others, or if the person would belong to more than `most` teams.
  absl::Status FoundTeam(const std::string& team, const std::string& person, int64_t most);
  // The old name still finds the team. FailedPreconditionError if the new one is or was another
  // team's; otherwise the name errors of Accept.
  absl::StatusOr<bool> RenameTeam(const std::string& team, const std::string& name,
                                  const std::string& who, const std::string& why);
  absl::StatusOr<bool> SetMember(const std::string& team, const std::string& person, bool belongs,
                                 const std::string& who);
  // From now on `team` is a part of `into`: its submissions, its ledger, its tokens and its members
  // are those of `into`. No row that tells what happened changes. Can't be undone.
  // FailedPreconditionError if both are one team, if either was merged before, or is banned.
  absl::Status MergeTeams(const std::string& team, const std::string& into, const std::string& who,
                          const std::string& why);
  absl::StatusOr<bool> BanTeam(const std::string& team, bool banned, const std::string& who,
                               const std::string& why);

  // Bearer tokens. Returns the new one's id. NotFoundError with the code "unknown_team";
  // InvalidArgumentError for a role that does not fit the team, or a time in the past.
  absl::StatusOr<int64_t> AddToken(const NewToken& token, const std::string& who);
  absl::StatusOr<bool> RevokeToken(int64_t id, const std::string& who);
  // Notes that it was used now. Writes at most once a minute.
  absl::Status TouchToken(int64_t id);

  // Sets or clears a mark; true if that changed anything (setting it again for the same reason does
  // not). NotFoundError if there is no such submission.
  absl::StatusOr<bool> Mark(int64_t submission, const std::string& mark, bool set,
                            const std::string& who, const std::string& why);
  // Adds an act on a phase, or on all submissions (`phase` ""); true if that changed anything: what
  // is paused is not paused again for the same reason, nor published or revealed twice.
  absl::StatusOr<bool> AddPhaseEvent(const std::string& phase, const std::string& event,
                                     const std::string& who, const std::string& why);
  // The secret of a challenge's phase with hidden seeds, 32 bytes, drawn when it is first asked for and
  // committed to in the record. A damaged row (damage.h) if it is not that long. FailedPreconditionError
  // with the code "no_secret": it belongs to another challenge, or there is none although the store has
  // a commitment, submissions or events of the phase; "phase_revealed": another challenge's, which was
  // revealed. `challenge` "": whichever it is.
  absl::StatusOr<std::string> PhaseSecret(const std::string& phase,
                                          const std::string& challenge = "");
  // The same for further episodes of a phase, which may have been played with public seeds before.
  absl::StatusOr<std::string> FurtherSecret(const std::string& phase);
  // Keeps the secret of a phase that was held elsewhere, and whose record was imported; true if it is
  // new here. FailedPreconditionError: it is not the one that the record has committed to first.
  absl::StatusOr<bool> TakeSecret(const std::string& phase, const std::string& secret);
  // Makes a submission the one that its team stands with among those under the same config; true if
  // that changed anything. NotFoundError if there is no such submission; FailedPreconditionError if
  // it is not ranked, or not done.
  absl::StatusOr<bool> Choose(int64_t submission, const std::string& who);
  // Sets or replaces what a finished evaluation is ranked by.
  absl::Status SetStanding(int64_t evaluation, const Standing& standing);
  absl::Status DropStandings();
  // Counts denied requests in today's row of equal ones. Once today has kMostDenialsOfADay rows, new
  // kinds count in that of `others`.
  absl::Status AddDenial(AccessEventRow event, const AccessEventRow& others);
  // Removes denials of before, some thousands at a time.
  void RemoveDenials(int64_t before_ms);
  // Notes a time (ms) for Store::trusted_time_ms(); an earlier one than is there changes nothing.
  void SetTrustedTime(int64_t ms);
  // Adds an act, as of now; `event.id` and `event.at` are ignored.
  absl::Status AddAccessEvent(const AccessEventRow& event);
  // Adds the row for removing the files of an artefact or a log (`name` is its hash); false, and no
  // row, if they are needed. Of kPracticeLogKind, those of a practice that has not ended are not.
  absl::StatusOr<bool> Remove(const std::string& kind, const std::string& name, int64_t bytes,
                              const std::string& why);
  // Fills an empty store; errors as in transfer.h. Evaluations that had not ended when exported end
  // as cancelled, as exports have no artefact files.
  // `check`: what the store's readers can't tell of its new rows; its error undoes the whole.
  absl::Status Import(const std::string& path, const ExportInfo& info, const std::string& who,
                      const std::function<absl::Status(Reader&)>& check);
  // Gives a board its config from now on; true if it had another one. A rejudge's act is always added. FailedPreconditionError if the store has neither the config nor its JSON.
  absl::StatusOr<bool> SetBoardConfig(const NewBoardConfig& change, const std::string& who);

  // Adds to the public record (journal.h) the key that signs from now on, unless it is the latest
  // one already.
  absl::Status AppendKey(const std::string& public_pem);

  // Rejudges (rejudges.h). Adds one with its event 'created'.
  absl::StatusOr<RejudgeRow> AddRejudge(const NewRejudge& rejudge, const SignDocument& sign,
                                        const std::string& who);
  // An item to play. The answer's `evaluation` is to be queued unless the item is impossible. Adding
  // an item that is there changes nothing, and `repeated` is true. FailedPreconditionError if the
  // rejudge was dropped.
  absl::StatusOr<Accepted> AddRejudgeItem(const NewRejudgeItem& item, const std::string& who);
  // An item that was computed. True if it is new; otherwise as AddRejudgeItem.
  absl::StatusOr<bool> AddJudgedItem(const JudgedItem& item, const std::string& who);
  // Event and board_config row. FailedPreconditionError, in one sentence: it is of purpose kSeeds, is
  // applied already, is not complete, has other submissions without result than `without` says, or
  // the board's config in force is not from_config.
  absl::StatusOr<RejudgeDone> ApplyRejudge(const RejudgeAct& act, const SignDocument& sign,
                                           const std::string& who);
  // Event; cancels its unfinished evaluations; if it was applied, the board has its config of before.
  // FailedPreconditionError: it was dropped before, or a later one of its board is applied.
  absl::StatusOr<RejudgeDone> DropRejudge(const RejudgeAct& act, const SignDocument& sign,
                                          const std::string& who);

  // Webhooks (deliveries.h). Adds what is to be told of an event, for each webhook that wants it.
  // `about_json`: an object; "id", "event" and "at" are added to it.
  absl::Status Tell(const std::string& event, const std::string& about_json);
  absl::Status SetDelivery(int64_t id, const DeliveryOutcome& outcome);
  // Gives up what waits for webhooks other than these; returns how many.
  absl::StatusOr<int64_t> GiveUpStrangers(const std::set<std::string>& webhooks);
  // Removes what was delivered or given up, of events before then.
  absl::Status PruneDeliveries(int64_t before_ms);

 private:
  absl::StatusOr<LeaseRow> Lease(int64_t lease);
  absl::Status Audit(const char* entity, int64_t id, std::string_view from, std::string_view to,
                     const std::string& who, const std::string& why);
  struct NewEvaluation {
    int64_t submission = 0;
    EvaluationKind kind = EvaluationKind::kOriginal;
    std::string config = "";  // "": the submission's
    std::string seeds = "";
    std::string grader_json;
    std::vector<std::pair<int64_t, int64_t>> blocks;
    int64_t rejudge = 0;  // 0: of none, and nothing below counts
    int64_t repetition = 0;
    int64_t source = 0;
    RejudgeMethod method = RejudgeMethod::kPlay;
  };
  void Append(const NewAct& act) { AppendAct(db_, now_ms_, act); }
  void AppendGraded(int64_t evaluation, const std::string& who);
  absl::StatusOr<Accepted> AddEvaluation(const NewEvaluation& added, const std::string& who);
  // Content rows, each found by the SHA-256 of its text and never changed. Each is added unless it
  // is there. A damaged row (damage.h) if what is there under this hash is not this text.
  absl::Status AddConfig(const std::string& hash, const std::string& track,
                         const std::string& profile, const std::string& json);
  absl::Status AddSeedList(const std::string& hash, int64_t count, const std::string& json);
  absl::Status RunEvaluation(int64_t evaluation, const std::string& who);
  // The rejudge that an item is to be added to; nullopt if the item is there.
  absl::StatusOr<std::optional<RejudgeRow>> RejudgeWithout(int64_t rejudge, int64_t submission,
                                                           int64_t repetition);
  absl::StatusOr<RejudgeEventRow> AddRejudgeEvent(const RejudgeRow& rejudge, RejudgeEvent event,
                                                  const std::string& why, const SignDocument& sign,
                                                  const std::string& who);
  absl::StatusOr<RejudgeDone> MoveBoard(const RejudgeRow& rejudge, RejudgeDone done,
                                        const std::string& who);
  void AddNodeEvent(const std::string& node, const char* event, const std::string& why,
                    const std::string& who);
  // The ranked evaluation that rules out another one; nullopt: none.
  absl::StatusOr<std::optional<Accepted>> FindOfficial(const NewSubmission& submission,
                                                       const AdmissionRules& rules);
  // FailedPreconditionError with the code "paused" or "phase_revealed".
  absl::Status CheckTakesSubmissions(const std::string& phase);
  absl::StatusOr<std::string> DrawSecret(const std::string& phase, const std::string& challenge,
                                         bool further);
  void AddSecret(const std::string& phase, const std::string& challenge,
                 const std::string& secret);
  void ChargeFirstEpisode(int64_t evaluation, const std::string& why);
  void SettleCharge(int64_t evaluation, EvaluationState state, const std::string& who);

  // Tells that an evaluation has ended, if it is a submission's own.
  void TellEnd(int64_t evaluation, EvaluationState state);

  SQLite::Database& db_;
  int64_t now_ms_;
  BoardState& board_;
  const Subscriptions* subscriptions_;
};

class Store {
 public:
  // Opens or creates the store at `path`; errors as in connection.h. `clock` must outlive it. Not
  // thread-safe.
  static absl::StatusOr<std::unique_ptr<Store>> Open(const std::string& path, const Clock& clock);
  ~Store();

  // Runs `change` in one transaction; commits if it returns OkStatus(). Errors of Check().
  absl::Status Write(const std::function<absl::Status(Writer&)>& change);

  // Whether what is written now would still be there tomorrow. UnavailableError: the store's file, or
  // its write-ahead log, was removed, replaced, cut off or overwritten with an older one since it was
  // opened, or somebody found it corrupt. Safe from any thread.
  absl::Status Check();
  // From now on Check() fails for this reason: the store is corrupt.
  void Distrust(const std::string& why);

  // A time before this start that is surely over: what Writer::SetTrustedTime wrote last, else that of the
  // newest row; nullopt: there was neither.
  std::optional<int64_t> trusted_time_ms() const { return trusted_time_ms_; }

  // Who is told of what is written from now on. Not while anybody writes.
  void SetSubscriptions(Subscriptions subscriptions) { subscriptions_ = std::move(subscriptions); }

  // 32 random bytes, created with the store: the key of policy seeds under configs of form 1.
  const std::string& policy_secret() const { return policy_secret_; }
  // What was unreadable on opening, and was rebuilt.
  const std::optional<Damage>& mended() const { return mended_; }
  // How opening it changed the schema of a store that was there; the copy of what it was is kept.
  const std::optional<Migration>& migration() const { return migration_; }

 private:
  Store(std::string path, std::unique_ptr<SQLite::Database> db, const Clock& clock);
  absl::Status LoadSecret();

  // A file as it was when the store was opened.
  struct File {
    std::string path;
    uint64_t device = 0;
    uint64_t inode = 0;
  };
  static std::vector<File> FilesOf(const std::string& path);

  // What changes in the files at each checkpoint alone, and so tells when to read what is in them.
  struct Look {
    int64_t modified_ns = 0;  // the database file
    int64_t wal_bytes = 0;    // its log gets shorter only by a checkpoint
  };
  static Look LookAt(const std::string& path);
  // Distrusts the store if what was written last is not in its files any more.
  void Watch();
  void Remember(int64_t rows);

  std::string path_;
  std::vector<File> files_;
  mutable Mutex mutex_;
  std::string distrust_ ABSL_GUARDED_BY(mutex_);  // "": none
  Look look_ ABSL_GUARDED_BY(mutex_);
  int64_t rows_ ABSL_GUARDED_BY(mutex_) = 0;  // RowsEver as of the last write
  std::unique_ptr<SQLite::Database> db_;
  BoardState board_;  // of the journal; empty again after what was rolled back
  const Clock& clock_;
  std::optional<int64_t> trusted_time_ms_;
  std::string policy_secret_;
  std::optional<Damage> mended_;
  std::optional<Migration> migration_;
  Subscriptions subscriptions_;
};

}  // namespace myograde::server
