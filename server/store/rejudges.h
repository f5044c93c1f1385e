// Rejudges: all submissions of a board judged again, under another config (purpose "rules") or with
// further episodes (purpose "seeds"). schema.sql describes the tables.
//
// The operations are Writer's (AddRejudge, AddRejudgeItem, AddJudgedItem, ApplyRejudge,
// DropRejudge), the views Reader's (Rejudge, Rejudges, RejudgeEvents, RejudgeItems, ProgressOf,
// MissingItems).
//
//   created ──(every item has ended)── ready ──apply──► applied ──drop──► dropped
//      └───────────────────drop──────────┴───────────────► dropped ──apply──► applied, if complete
//
// While it is created or applied it follows the board: a submission whose evaluation under
// from_config ends later gets items too. A dropped one whose items are complete may be applied.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/rows.h"

namespace myograde::server {

enum class RejudgePurpose {
  kRules,  // the results of to_config take the place of those of from_config
  kSeeds,  // further episodes for statistics, of the listed submissions; they never rank
};
std::string_view RejudgePurposeName(RejudgePurpose purpose);  // "rules", "seeds"
std::optional<RejudgePurpose> ParseRejudgePurpose(std::string_view name);

enum class RejudgeMethod {
  kAuto,   // from facts where that gives what playing would give, else played
  kFacts,  // judged anew from the facts of an evaluation
  kPlay,   // played
};
std::string_view RejudgeMethodName(RejudgeMethod method);  // "auto", "facts", "play"
std::optional<RejudgeMethod> ParseRejudgeMethod(std::string_view name);

enum class RejudgeEvent { kCreated, kApplied, kDropped };
std::string_view RejudgeEventName(RejudgeEvent event);  // "created", "applied", "dropped"
std::optional<RejudgeEvent> ParseRejudgeEvent(std::string_view name);

inline constexpr int64_t kMostRepeats = 20;

struct RejudgeRow {
  int64_t id = 0;
  int64_t at = 0;
  RejudgePurpose purpose = RejudgePurpose::kRules;
  std::string phase;  // "": the track's own board
  std::string track;
  std::string profile;
  std::string from_config;  // hashes
  std::string to_config;
  std::string seeds;        // of to_config
  RejudgeMethod method = RejudgeMethod::kAuto;
  int64_t repeats = 1;      // items per submission
  std::string who;
  std::string why;
};

struct RejudgeEventRow {
  int64_t id = 0;
  int64_t at = 0;
  int64_t rejudge = 0;
  RejudgeEvent event = RejudgeEvent::kCreated;
  std::string who;
  std::string why;
  std::string document_json;  // canonical
  std::string signature;      // 128 hexadecimal digits: Ed25519 over document_json
};

struct RejudgeItemRow {
  int64_t rejudge = 0;
  int64_t submission = 0;
  int64_t repetition = 1;
  int64_t source = 0;  // the evaluation that it is the new result of
  RejudgeMethod method = RejudgeMethod::kPlay;  // kFacts or kPlay
  int64_t evaluation = 0;
  // Of the evaluation.
  EvaluationState state = EvaluationState::kQueued;
  std::string reason = "";
  std::string results_hash = "";
};

// What a rejudge has to do next for a submission.
struct RejudgeCandidate {
  int64_t submission = 0;
  int64_t source = 0;      // its evaluation in force under from_config; done or failed
  int64_t repetition = 1;  // that it has no item of yet
};

// Where it stands. In `without_result` are the submissions with an item (of repetition 1) that ended
// as grader_error or cancelled: they can't be on the board once it is applied.
struct RejudgeProgress {
  enum class State { kComputing, kReady, kApplied, kDropped };
  State state = State::kComputing;
  int64_t submissions = 0;  // that have or need items
  int64_t items = 0;        // there are
  int64_t missing = 0;      // items still to be added
  int64_t facts = 0;        // items computed from facts
  int64_t play = 0;         // items to play, or played
  int64_t waiting = 0;      // items queued
  int64_t running = 0;
  int64_t ended = 0;        // in any way
  int64_t cancelled = 0;    // of those
  int64_t episodes = 0;       // of all items
  int64_t episodes_done = 0;
  std::vector<int64_t> without_result;  // sorted
  // Nothing is missing and everything has ended, not by being dropped. Only then it may be applied.
  bool complete = false;
};
std::string_view RejudgeStateName(RejudgeProgress::State state);  // "computing", "ready", ...

// A rejudge to create. Content that the store already has is shared.
struct NewRejudge {
  RejudgePurpose purpose = RejudgePurpose::kRules;
  std::string phase = "";  // "": the track's own board
  std::string track;
  std::string profile;
  std::string from_config;       // hash of from_config_json
  std::string from_config_json;  // effective, canonical
  std::string to_config;
  std::string to_config_json;
  std::string seeds;       // hash of seeds_json: those of to_config
  std::string seeds_json;  // array of numbers, canonical
  int64_t seed_count = 0;
  RejudgeMethod method = RejudgeMethod::kAuto;
  int64_t repeats = 1;     // 1 to kMostRepeats
  std::string why;
  // The build that plays its items; "": this host's, as the engine finds it.
  std::string grader_json = "";
  // Purpose kSeeds: exactly these get items, all in the change that creates it. Otherwise empty.
  std::vector<int64_t> submissions = {};
};

// What an event says, and its signature.
struct SignedDocument {
  std::string json;       // canonical
  std::string signature;  // 128 hexadecimal digits
};
// Makes an event's document. Called inside the change, as the id and the time are known only there:
// `event` has all but the document and the signature. An error undoes the change.
using SignRejudge =
    std::function<absl::StatusOr<SignedDocument>(const RejudgeRow& rejudge,
                                                 const RejudgeEventRow& event)>;

// An item to play: its evaluation is queued.
struct NewRejudgeItem {
  int64_t rejudge = 0;
  int64_t submission = 0;
  int64_t repetition = 1;
  int64_t source = 0;
  RejudgeMethod method = RejudgeMethod::kPlay;
  std::string grader_json;  // of the build that plays it
  std::vector<std::pair<int64_t, int64_t>> blocks = {};  // first and last episode of each lease
  // Not "": it can't be played, or computed, for this reason: its evaluation ends as grader_error at
  // once.
  std::string impossible = "";
};

// An item that was computed from facts: its evaluation is added as one that has ended. The facts,
// leases and their outputs are copied from the source.
struct JudgedItem {
  int64_t rejudge = 0;
  int64_t submission = 0;
  int64_t repetition = 1;
  int64_t source = 0;
  EvaluationState state = EvaluationState::kDone;  // or kFailed
  std::string reason = "";
  std::string results_hash = "";
  // By index, one for each of the source; only index, outcome, reason and metrics_json are used.
  std::vector<EpisodeRow> episodes = {};
  Standing standing = {};  // of kDone
};

// An act on a rejudge.
struct RejudgeAct {
  int64_t rejudge = 0;
  std::string why;
  // For apply: the submissions that the caller knows to have no result. It must name exactly
  // RejudgeProgress::without_result.
  std::vector<int64_t> without = {};
  // For apply: the hash of the config in force on its board, for a board without a board_config row.
  std::string in_force = "";
};

struct RejudgeDone {
  RejudgeEventRow event;
  // The config in force on the board before and after; equal if the act did not change it.
  std::string config_before;
  std::string config_after;
  std::vector<int64_t> cancelled;  // evaluations that a drop ended
  // Of a drop: ranked submissions accepted under to_config since it was applied; they stay under it.
  int64_t stay = 0;
};

// A submission whose repetitions came out differently.
struct Unrepeatable {
  int64_t submission = 0;
  struct Episode {
    int64_t index = 0;
    int64_t repetition = 0;  // that differs from the first one, or from itself if played twice
    std::vector<std::string> differs;  // as of RepeatRow
  };
  std::vector<Episode> episodes;
};

}  // namespace myograde::server
