// Rejudges (server/board/acts.h) in the store: the evaluations that they need and have, and what
// organisers ask for.
//
// While it is created or applied it follows the board: a submission whose evaluation under
// from_config ends later is judged again too. A dropped one whose evaluations are complete may be
// applied.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/board/acts.h"
#include "server/store/context.h"
#include "server/store/evaluations.h"

namespace myograde::server {

// Where it stands.
struct RejudgeProgress {
  enum class State { kComputing, kReady, kApplied, kDropped };
  State state = State::kComputing;
  int64_t submissions = 0;  // that have or need items
  int64_t items = 0;        // there are
  int64_t missing = 0;      // items still to be added
  int64_t facts = 0;        // items computed from facts
  int64_t play = 0;         // items to play, or played
  int64_t ended = 0;        // in any way
  int64_t cancelled = 0;    // of those
  int64_t episodes = 0;     // of all items
  int64_t episodes_done = 0;
  // Items (of repetition 1) that ended as grader_error or cancelled, by submission: those can't be
  // on the board once it is applied.
  std::vector<EvaluationRow> without_result;
  // Nothing is missing and everything has ended, not by being dropped. Only then it may be applied.
  bool complete = false;
};
template <>
inline constexpr std::string_view kNamesOf<RejudgeProgress::State>[] = {"computing", "ready",
                                                                        "applied", "dropped"};

// A rejudge to create, with the contents of its hashes; its id, time and events are given to it.
// Content that the store already has is shared.
struct NewRejudge : RejudgeRow {
  std::string from_config_json;  // effective, canonical
  std::string to_config_json;
  std::string seeds_json;  // array of numbers, canonical
  // The build that plays its items; "": this host's, as the engine finds it.
  std::string grader_json = "";
};

// Signs the document of an act: 128 hexadecimal digits. Called inside the change, whose id and time
// are known only there; an error undoes the change.
using SignDocument = std::function<absl::StatusOr<std::string>(const std::string& document_json)>;

// An item to add.
struct NewRejudgeItem : EvaluationRow {
  EpisodeBlocks blocks = {};
  // grader_error: it can't be played, or computed, and ends at once, for its reason. done or
  // failed: it was computed from facts, and is added with the facts, blocks and outputs of the
  // source. Of `episodes`, by index and one for each of the source, only index, outcome, reason and
  // metrics_json are used.
  EvaluationResult result = {.state = EvaluationState::kQueued};
  std::vector<EpisodeRow> episodes = {};
};

// An act on a rejudge.
struct RejudgeAct {
  int64_t rejudge = 0;
  std::string why;
  // For apply: the submissions that the caller knows to have no result. It must name exactly
  // RejudgeProgress::without_result.
  std::set<int64_t> without = {};
};

struct RejudgeDone {
  RejudgeEventRow event;
  // The config in force on the board before and after; equal if the act did not change it.
  std::string config_before;
  std::string config_after;
  std::vector<int64_t> cancelled;  // evaluations that a drop ended
  // Of a drop: ranked submissions accepted under to_config since it was applied; they stay under
  // it.
  int64_t stay = 0;
};

// What organisers ask for, and the evaluations that follow.
class Rejudges : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<RejudgeRow> Find(int64_t id) const;
  absl::StatusOr<RejudgeProgress> CountProgress(const RejudgeRow& rejudge) const;
  // The items that it lacks, first repetitions first, without what depends on how they are made. Of
  // one that is still to be created, all.
  std::vector<EvaluationRow> MissingItems(const RejudgeRow& rejudge) const;
  // By submission, every episode that repetitions which have ended as done or failed differ in.
  absl::StatusOr<std::map<int64_t, std::vector<RepeatRow>>> ListUnrepeatable(int64_t rejudge) const;
  // Adds one with its event 'created'.
  absl::StatusOr<RejudgeRow> Add(const NewRejudge& rejudge, const SignDocument& sign,
                                 const std::string& who);
  // The answer has blocks if its `evaluation` is to be queued. Adding an item that is there changes
  // nothing, and `repeated` is true. FailedPreconditionError if the rejudge was dropped.
  absl::StatusOr<Accepted> AddItem(const NewRejudgeItem& item, const std::string& who);
  // Applies or drops it: adds the event, and gives the board the config that it has then.
  // FailedPreconditionError, in one sentence: to apply, it is of purpose kSeeds, is applied already,
  // is not complete, has other submissions without result than `without` says, or the board's config
  // in force is not from_config; to drop, it was dropped before, or a later one of its board is
  // applied.
  absl::StatusOr<RejudgeDone> End(bool apply, const RejudgeAct& act, const SignDocument& sign,
                                  const std::string& who);

 private:
  absl::StatusOr<Accepted> AddJudged(const NewRejudgeItem& item, const std::string& who);
  absl::StatusOr<RejudgeEventRow> AddEvent(const RejudgeRow& rejudge, RejudgeEvent event,
                                           const std::string& why, const SignDocument& sign,
                                           const std::string& who);
  // Cancels its unfinished evaluations; if it was applied, the board is to have its config of before.
  absl::Status Drop(const RejudgeRow& rejudge, const std::string& who, RejudgeDone& done);
};

}  // namespace myograde::server
