// The acts that the journal holds (server/store/journal.h), and what they tell of each thing that
// they are about. An act is a JSON object; its public keys are an entry of the public record, which
// anybody may check afterwards:
//
//   {"at": "2026-11-22T19:20:38.000Z", "kind": "accepted", ...}
//
//   accepted   a ranked submission: "submission", "evaluation", "team", "team_id", "track",
//              "profile", "phase", "config", and "artefact", which commits to the artefact's hash
//              without telling it (ArtefactCommitment)
//   graded     how a ranked evaluation ended: "submission", "evaluation", "rejudge" and
//              "repetition" (null: it is the original), "state", "results", "config", "seeds" and
//              "grader". The state is "graded" for done and for failed ones, as that is a result,
//              which boards may withhold; else "cancelled" or "grader_error", and "results" is null.
//              "results" is the hash of all episodes' results, "grader" that of the build
//   marked     "submission", "mark", "set", and "reason", if the board tells it
//   chosen     "submission"
//   team       "event", "team_id", "team" (its name afterwards), "into" (the id of the team that it
//              was merged into)
//   commitment "phase" and "commitment": to the secret that its seeds and their salt follow from;
//              with "further": true, only the seeds of its further episodes do
//   phase      "event" ("paused", "resumed", "published", "revealed"), "phase" (null: all
//              submissions), and "secret" when it is revealed
//   config     the config that a board has from now on: "phase", "track", "profile", "config",
//              "rejudge"
//   rejudge    "event", "rejudge", "document_sha256", "signature", and the document itself once it
//              is applied
//   key        the key that signs receipts and heads from now on: "key" (PEM)
//
// No entry has a score, a seed, or anything of an artefact. Private keys: "failed" of graded; "why"
// of marked, team and phase; "detail" of team (the name before, or the team that it was merged
// into); "document" of rejudge.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/base/enum_names.h"

namespace myograde::server {

inline constexpr char kAcceptedAct[] = "accepted";
inline constexpr char kGradedAct[] = "graded";
inline constexpr char kMarkedAct[] = "marked";
inline constexpr char kChosenAct[] = "chosen";
inline constexpr char kTeamAct[] = "team";
inline constexpr char kCommitmentAct[] = "commitment";
inline constexpr char kPhaseAct[] = "phase";
inline constexpr char kConfigAct[] = "config";
inline constexpr char kRejudgeAct[] = "rejudge";
inline constexpr char kKeyAct[] = "key";

struct Act {
  int64_t id = 0;  // in the journal, from 1 on; of a record without a journal, its index + 1
  int64_t at = 0;  // ms since 1970-01-01 UTC
  std::string kind;
  std::string who;         // "": not told
  int64_t entry = -1;      // its index in the public record; -1: it is not public
  nlohmann::json content;  // public and private keys
};

// What every act tells.
struct ActRow {
  int64_t id = 0;
  int64_t at = 0;
  std::string who;
  std::string why;  // "": no reason is told
};

// The act that an entry of a public record tells. InvalidArgumentError if it has no kind or no
// time.
absl::StatusOr<Act> ActOfEntry(int64_t index, nlohmann::json entry);

// What an entry has of an artefact: SHA-256 over "myograde artefact/SUBMISSION/HASH".
std::string ArtefactCommitment(int64_t submission, const std::string& artefact);

// The board of a phase or, if `phase` is "", of a track's profile. (The boards of scoring, "main"
// and others, are different orders of the same entries.)
struct BoardName {
  std::string phase;
  std::string track;
  std::string profile;

  auto operator<=>(const BoardName&) const = default;
};

// As of when a board is asked for. What happened from `before_ms` on is left out.
struct BoardMoment {
  int64_t before_ms = INT64_MAX;
  // A freeze: results, choices and rejudges from then on are left out, while marks count.
  int64_t freeze_ms = INT64_MAX;
  // The ids of rejudges that count as applied, after all others, and as never applied; 0: none.
  int64_t assumed_rejudge = 0;
  int64_t ignored_rejudge = 0;

  int64_t results_before_ms() const { return before_ms < freeze_ms ? before_ms : freeze_ms; }
};

// From then on the board had this config.
struct BoardConfigRow : ActRow {
  std::string config;       // its hash
  int64_t rejudge = 0;      // whose act it was; 0: the config files changed
  std::string from_config;  // of that rejudge; "": none
};

// One change of a mark. The newest of a submission and mark is in force.
inline constexpr char kHidden[] = "hidden";
inline constexpr char kDisqualified[] = "disqualified";
inline constexpr char kBaseline[] = "baseline";
struct MarkRow : ActRow {
  int64_t submission = 0;
  std::string mark;
  bool set = false;
};

// The marks in force, by submission and name.
using Marks = std::map<std::pair<int64_t, std::string>, MarkRow>;

// An act on a team.
struct TeamEventRow : ActRow {
  std::string team;    // today's name of the team that it was done to
  std::string event;   // "created", "renamed", "merged", "banned", "unbanned"
  std::string detail;  // the name before, or the team that it was merged into; else ""
};

// An act on a phase of a challenge. The newest pause or resumption of a phase is in force; the
// others are never taken back.
inline constexpr char kPausedEvent[] = "paused";
inline constexpr char kResumedEvent[] = "resumed";
inline constexpr char kPublishedEvent[] = "published";
inline constexpr char kRevealedEvent[] = "revealed";
struct PhaseEventRow : ActRow {
  std::string phase;  // "" for a pause and a resumption: all submissions
  std::string event;
};

// Rejudges: all submissions of a board judged again.
//
//   created ──(every evaluation of it has ended)── ready ──apply──► applied ──drop──► dropped
//      └───────────────────drop─────────────────────┴───────────────► dropped ──apply──► applied,
//                                                                                  if complete
enum class RejudgePurpose {
  kRules,  // the results of to_config take the place of those of from_config
  kSeeds,  // further episodes for statistics, of the listed submissions; they never rank
};
template <>
inline constexpr std::string_view kNamesOf<RejudgePurpose>[] = {"rules", "seeds"};

enum class RejudgeMethod {
  kAuto,   // from facts where that gives what playing would give, else played
  kFacts,  // judged anew from the facts of an evaluation
  kPlay,   // played
};
template <>
inline constexpr std::string_view kNamesOf<RejudgeMethod>[] = {"auto", "facts", "play"};

enum class RejudgeEvent { kCreated, kApplied, kDropped };
template <>
inline constexpr std::string_view kNamesOf<RejudgeEvent>[] = {"created", "applied", "dropped"};

struct RejudgeEventRow : ActRow {
  int64_t rejudge = 0;
  RejudgeEvent event = RejudgeEvent::kCreated;
  nlohmann::json document;  // null: it is not public
  std::string signature;    // 128 hexadecimal digits: Ed25519 over the document's canonical JSON
};

inline constexpr int64_t kMostRepeats = 20;

struct RejudgeRow {
  int64_t id = 0;
  int64_t at = 0;
  RejudgePurpose purpose = RejudgePurpose::kRules;
  BoardName board;
  std::string from_config;  // hashes
  std::string to_config;
  std::string seeds;  // of to_config
  RejudgeMethod method = RejudgeMethod::kAuto;
  int64_t repeats = 1;  // evaluations of each submission
  std::set<int64_t> submissions;  // of purpose kSeeds: those that get results; otherwise empty
  std::string who;
  std::string why;
  std::vector<RejudgeEventRow> events;  // oldest first

  // The newest event; kCreated if none is known.
  RejudgeEvent last() const {
    return events.empty() ? RejudgeEvent::kCreated : events.back().event;
  }
};

// What every document and answer about a rejudge tells of it: purpose, board, configs and method.
nlohmann::json RejudgeKeys(const RejudgeRow& rejudge);

}  // namespace myograde::server
