// What submissions, uploads and reruns are made of, what they must satisfy, and what they were
// accepted as; and the keys (the header Idempotency-Key) by which a client may send one again when
// the answer was lost.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/time/time.h>

#include "server/store/context.h"
#include "server/store/damage.h"
#include "server/store/quota.h"
#include "server/store/rows.h"

namespace myograde::server {

using EpisodeBlocks = std::vector<std::pair<int64_t, int64_t>>;  // first and last episode of each

struct Accepted {
  int64_t submission = 0;
  int64_t evaluation = 0;
  std::vector<int64_t> blocks = {};  // in block order
  // True: nothing new was accepted. The team already has this artefact's ranked evaluation;
  // `submission` and `evaluation` are those, and `blocks` is empty.
  bool linked = false;
  // True: nothing new was accepted, as the same request came before with the same key. All but
  // `blocks`, which is empty, is what it was accepted as then.
  bool repeated = false;

  bool is_new() const { return !linked && !repeated; }
};

struct RequestKey {
  std::string key = "";      // chosen by the client; "": the request has none
  std::string request = "";  // SHA-256 of everything that it asks for
};

// A key is kept for this long, and of one caller the newest of these.
inline constexpr absl::Duration kKeyAge = absl::Hours(24);
inline constexpr int64_t kKeysOfOne = 1000;

// Who becomes a team's first member.
struct Founding {
  std::string person;  // "uid 1000"
  int64_t most = 1;    // teams that the person may have (Teams::Found)
  bool needed = true;  // false: it does not matter if the team is somebody else's
};

// A submission to accept, without what its acceptance adds. Its artefact must be in the store; other
// content that the store already has is shared.
struct NewSubmission : SubmissionRow {
  std::string config_json;  // the effective track config, canonical; `config` is its hash
  std::string seeds_json;   // array of numbers, canonical; `seeds` is its hash
  std::string grader_json;
  EpisodeBlocks blocks;
  RequestKey request_key = {};
  std::optional<Founding> founding = std::nullopt;  // of its team, in the same change
  // Why nothing new is accepted; OkStatus(): it is. The ranked evaluation that an artefact has
  // already is found all the same.
  absl::Status closed = absl::OkStatus();
};

struct NewRerun {
  int64_t submission = 0;
  std::string artefact;  // the submission's
  std::string grader_json;
  EpisodeBlocks blocks;
  RequestKey request_key = {};
};

// Who uploaded an artefact that has not been submitted yet.
struct NewUpload {
  std::string uploader;    // "uid 1000"
  std::string team;        // "": unknown
  bool organiser = false;  // only the limits on the total apply
};

// Which submissions to list, newest first. Empty strings match any.
struct SubmissionFilter {
  std::string team = "";
  std::string track = "";
  std::string profile = "";
  std::string phase = "";
  std::optional<EvaluationState> state = std::nullopt;        // of the original evaluation
  std::optional<std::set<std::string>> teams = std::nullopt;  // only theirs
  int64_t before = INT64_MAX;                                 // only ids below
  int64_t limit = 100;
};

// Submissions: what is accepted, and what is refused.
class Submissions : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<SubmissionRow> Find(int64_t id) const;
  Listed<SubmissionRow> List(const SubmissionFilter& filter) const;
  // Artefacts that are held back (Submissions::WithHold), sorted: as of the grader that played them
  // last.
  std::vector<std::string> HeldBack() const;
  // Whose it is: today's name of the team. NotFoundError if there is no such submission or
  // evaluation, or if nobody can tell whose it is.
  absl::StatusOr<std::string> TeamOf(int64_t id) const;
  // What Submissions::Once would return without asking to accept; nullopt: it would ask.
  absl::StatusOr<std::optional<Accepted>> FindRequest(const std::string& who,
                                                      const RequestKey& key) const;
  // How many submissions' own evaluations are in each state; "unreadable" counts damaged ones.
  std::map<std::string, int64_t> CountByState() const;
  // NotFoundError if the artefact is not in the store; a damaged row (damage.h) if the stored
  // config or seeds are not those given. FailedPreconditionError with the code "quota" if over a
  // quota, "same_artefact" for a second ranked evaluation of another team's artefact, "banned" for
  // a banned team, "look_alike" for a new team whose name looks like another's (ResembledTeam),
  // "paused" if all submissions or those to the phase are paused, "phase_revealed" if its seeds
  // were revealed; submission.closed. InvalidArgumentError for a name that no new team may have.
  // Other operations that take a team have the same name errors.
  absl::StatusOr<Accepted> Accept(const NewSubmission& submission, const AdmissionRules& rules,
                                  const std::string& who);
  // Runs `accept` if `who` has not sent this key before, and keeps what it accepted; otherwise
  // returns what was accepted then. Errors of `accept`, which keep nothing, and of FindRequestKey.
  absl::StatusOr<Accepted> Once(const std::string& who, const RequestKey& key,
                                const std::function<absl::StatusOr<Accepted>()>& accept);
  // `why` an evaluation ends by the grader's fault; says so too if that holds its artefact back: if
  // the last kFaultsToHold evaluations of it by this grader ended so. Call it before EndEvaluation.
  std::string WithHold(int64_t evaluation, const std::string& why);
  // Whether `who` may have one more rerun of a submission: FailedPreconditionError with the code
  // "quota" if too many have not ended, "banned" if its team is, or kHeldBackCode.
  absl::Status CheckReruns(int64_t submission, const std::string& who, bool organiser,
                           const RerunLimits& limits);
};

}  // namespace myograde::server
