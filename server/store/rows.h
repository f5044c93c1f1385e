// The store's rows as values. Times are milliseconds since 1970-01-01 UTC; 0 means "not yet".
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/outcome.h"
#include "protocol/lease/policy_image.h"
#include "server/base/enum_names.h"
#include "server/board/acts.h"

namespace myograde::server {

// Stored by name (schema.sql draws the transitions).
enum class BlockState { kPending, kRunning, kDone, kFailed, kCancelled };
template <>
inline constexpr std::string_view kNamesOf<BlockState>[] = {"pending", "running", "done", "failed",
                                                            "cancelled"};
inline bool IsFinal(BlockState state) { return state >= BlockState::kDone; }

enum class EvaluationState { kQueued, kRunning, kDone, kFailed, kCancelled, kGraderError };
template <>
inline constexpr std::string_view kNamesOf<EvaluationState>[] = {
    "queued", "running", "done", "failed", "cancelled", "grader_error"};
inline bool IsFinal(EvaluationState state) { return state >= EvaluationState::kDone; }

struct ArtefactRow : PolicyManifest {
  std::string hash;
  int64_t bytes = 0;
  int64_t files = 0;
};

struct SubmissionRow {
  int64_t id = 0;  // the acceptance number
  std::string team;
  std::string artefact;
  std::string artefact_name;
  std::string track;
  std::string profile;
  std::string config;  // hashes
  std::string seeds;
  bool ranked = false;
  int64_t accepted_at = 0;
  std::string accepted_by;  // who submitted it: "uid N"
  std::string phase;        // of a challenge; "": the track's own board
  bool extra_observations = false;  // its policy is shown TrackLayout::extra
};

enum class EvaluationKind {
  kOriginal,
  kRerun,    // of some episodes of the original, to compare
  kRejudge,  // the submission's result under another config
};
template <>
inline constexpr std::string_view kNamesOf<EvaluationKind>[] = {"original", "rerun", "rejudge"};

struct EvaluationRow {
  int64_t id = 0;
  int64_t submission = 0;
  EvaluationKind kind = EvaluationKind::kOriginal;
  int64_t first = 0;
  int64_t last = 0;
  EvaluationState state = EvaluationState::kQueued;
  std::string reason = {};
  std::string grader_json = {};  // the build that plays it
  std::string results_hash = {};
  int64_t started_at = 0;
  int64_t finished_at = 0;
  // Hashes of what it is played under: the submission's, unless it is a rejudge.
  std::string config = {};
  std::string seeds = {};
  // Of a rejudge; 0: of none.
  int64_t rejudge = 0;
  int64_t repetition = 0;  // from 1 on
  int64_t source = 0;      // the evaluation in force before, which has a result
  RejudgeMethod method = RejudgeMethod::kPlay;  // kFacts or kPlay
};

struct BlockRow {
  int64_t id = 0;
  int64_t evaluation = 0;
  int64_t first = 0;
  int64_t last = 0;
  BlockState state = BlockState::kPending;
  int64_t attempt = 0;
  int64_t faults = 0;
  std::string detail;
  int64_t slot = 0;  // 0 where it does not run
  int64_t started_at = 0;
  int64_t deadline_at = 0;
  int64_t finished_at = 0;
  std::string output_json;  // "" until an attempt has ended
};

// How an attempt of a block ended.
enum class RunEnd {
  kDone,
  kFault,     // the grader's
  kReturned,  // nobody's fault: it is played again
  kCancelled,
};
template <>
inline constexpr std::string_view kNamesOf<RunEnd>[] = {"done", "fault", "returned", "cancelled"};

// An attempt that has ended. Times are milliseconds since 1970-01-01 UTC, by the daemon's clock.
struct AttemptRow {
  int64_t block = 0;
  int64_t attempt = 0;
  std::string node = {};  // "": the daemon's own host
  std::string job = {};   // the cluster's name for it; "": none
  int64_t began_at = 0;   // 0: it never began
  int64_t ended_at = 0;
  double cpu_s = 0;  // of all its processes, exact to the millisecond; 0: not known
  std::optional<double> energy_j = {};  // exact to the millijoule; nullopt: not measured
  RunEnd how = RunEnd::kDone;
};

// A node that gets no blocks.
struct DrainedNodeRow {
  int64_t at = 0;
  std::string node;
  std::string who;
  std::string why;
};

struct EpisodeRow {
  int64_t evaluation = 0;
  int64_t index = 0;
  int64_t block = 0;
  int64_t attempt = 0;
  uint64_t seed = 0;
  Outcome outcome = Outcome::kFailure;
  FailureReason reason;
  std::string facts_json;
  std::string metrics_json;
  // What was measured besides; "": nothing. No result follows from it, so Episodes::Of leaves it
  // out (Episodes::Details has it).
  std::string details_json = {};
};

// An episode that was played again and came out otherwise.
struct RepeatRow {
  int64_t index = 0;
  std::vector<std::string> differs;  // as of DifferencesBetween
  int64_t repetition = 0;            // of a rejudge, that differs from its first, or from itself
};

struct EpisodeCounts {
  int64_t done = 0;
  int64_t success = 0;
  int64_t failure = 0;
  int64_t fault = 0;  // participant faults
};

struct TransitionRow {
  int64_t at = 0;
  std::string entity;  // "submission", "evaluation", "block"
  std::string from;
  std::string to;
  std::string who;
  std::string why;
};

// What an evaluation ends as.
struct EvaluationResult {
  EvaluationState state = EvaluationState::kDone;  // or kFailed
  std::string reason = "";
  std::string results_hash = "";
  nlohmann::json aggregate = {};  // AggregateToJson (server/grading/results.h)
};

// What an artefact's files are still needed for. Those of one that nobody has submitted are not.
struct ArtefactUse {
  std::string hash;
  int64_t bytes = 0;
  int64_t last_use = 0;  // the latest upload, acceptance or evaluation end
  bool needed = false;   // by an evaluation that has not ended, or is done and ranked, or by a
                         // rejudge that is neither applied nor dropped
};

// A row of a team's ledger; the rules are in quota.h.
struct LedgerRow {
  int64_t id = 0;
  int64_t at = 0;
  int64_t day = 0;  // since 1970-01-01 UTC: the day that it counts for
  std::string track;
  std::string phase;  // "": the track itself
  std::string budget;
  std::string entry;  // "charge", "refund", "grant"
  int64_t amount = 0;
  int64_t submission = 0;  // 0: none
  std::string who;
  std::string why;
};

// A team. Names that it had before, and the names of teams that were merged into it, find it too.
struct TeamRow {
  int64_t id = 0;
  std::string name;
  int64_t created_at = 0;
  bool banned = false;
  std::string merged_into;  // the name of the team that it is a part of now; "": none
  int64_t submissions = 0;  // with those of all teams that are one with it
  std::vector<std::string> other_names = {};  // sorted; none if it was merged
  std::vector<std::string> members = {};      // sorted: "uid 1000"; none if it was merged
};

// Somebody who belongs to a team.
struct MemberRow {
  std::string person;  // "uid 1000"
  int64_t since = 0;
  std::string who;  // who made them a member
};

// A bearer token. Its text is not kept, only the text's hash, which is never shown.
struct TokenRow {
  int64_t id = 0;
  std::string role;  // "participant", "organiser", "operator"
  std::string team;  // of a participant: today's name; else ""
  std::string label;
  int64_t created_at = 0;
  std::string created_by = {};
  int64_t expires_at = 0;  // 0: never
  int64_t revoked_at = 0;  // 0: it is not revoked
  std::string revoked_by = {};
  int64_t last_used_at = 0;  // to the minute; 0: it was never used
};

// A phase that has submissions, whether or not a file still describes it.
struct PhaseUse {
  std::string phase;
  std::string track;
  std::string profile;
  int64_t submissions = 0;
  int64_t waiting = 0;  // evaluations that have not ended
};

// A request that was denied, or an act of an organiser or operator.
struct AccessEventRow {
  int64_t id = 0;
  int64_t at = 0;
  std::string kind;     // "denied", "act"
  std::string who;      // "uid 1000", "token 7", "address 192.0.2.1"
  std::string role;
  std::string action;
  std::string subject;  // "submission 7"; "": nothing, or a stranger's text
  std::string detail;   // why it was denied, or what the act changed
  int64_t count = 1;    // equal denials
};

}  // namespace myograde::server
