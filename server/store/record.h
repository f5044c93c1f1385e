// The public record: what anybody may check afterwards. Entries are canonical JSON objects that are
// only ever added, each in the transaction of what it tells of:
//
//   {"at": "2026-11-22T19:20:38.000Z", "kind": "accepted", ...}
//
//   accepted   a ranked submission: "submission", "evaluation", "team", "team_id", "track",
//              "profile", "phase", "config", and "artefact", which commits to the artefact's hash
//              without telling it (ArtefactCommitment)
//   graded     how a ranked evaluation ended: "submission", "evaluation", "rejudge" and
//   "repetition"
//              (null: it is the original), "state", "results", "config", "seeds" and "grader". The
//              state is "graded" for done and for failed ones, as that is a result, which boards
//              may withhold; else "cancelled" or "grader_error", and "results" is null. "results"
//              are the hash of all episodes' results, "grader" that of the build
//   marked     "submission", "mark", "set", and why, if the board tells it
//   chosen     "submission"
//   team       "event", "team_id", "team" (its name afterwards), "into" (the id of the team that it
//              was merged into)
//   commitment "phase" and "commitment": to the secret that its seeds and their salt follow from;
//   with
//              "further": true, only the seeds of its further episodes do
//   phase      "event" ("paused", "resumed", "published", "revealed"), "phase" (null: all
//              submissions), and "secret" when it is revealed
//   config     the config that a board has from now on: "phase", "track", "profile", "config",
//              "rejudge"
//   rejudge    "event", "rejudge", "document_sha256", "signature", and the document itself once it
//              is applied
//   key        the key that signs receipts and heads from now on: "key" (PEM)
//
// No entry has a score, a seed, or anything of an artefact. One whose rows can't be read has
// "unreadable": true and the "row".
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>

#include "server/store/damage.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

class ReaderPool;

inline constexpr char kAcceptedEntry[] = "accepted";
inline constexpr char kGradedEntry[] = "graded";
inline constexpr char kMarkedEntry[] = "marked";
inline constexpr char kChosenEntry[] = "chosen";
inline constexpr char kTeamEntry[] = "team";
inline constexpr char kCommitmentEntry[] = "commitment";
inline constexpr char kPhaseEntry[] = "phase";
inline constexpr char kConfigEntry[] = "config";
inline constexpr char kRejudgeEntry[] = "rejudge";
inline constexpr char kKeyEntry[] = "key";

struct RecordRow {
  int64_t index = 0;
  std::string entry_json;
  std::string chain;
};

// The chain's value at an entry: the SHA-256 over the value at the entry before ("" for the first),
// a line feed and the entry.
std::string ChainOf(std::string_view before, std::string_view entry_json);

// What is wrong at an entry: nullptr if it can't be read or is gone. `before`: the chain at the
// entry before, "" for the first. "": nothing.
std::string ChainMistake(const std::string& before, const RecordRow* entry);

// The first entries, so many at most, at which the chain breaks. Errors of ReaderPool::Read.
absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most);

// What an entry has of an artefact: SHA-256 over "myograde artefact/SUBMISSION/HASH".
std::string ArtefactCommitment(int64_t submission, const std::string& artefact);

// Adds the entry of a row: of kind "accepted" of a submission, "graded" of an evaluation, "marked"
// of a mark, "chosen" of a choice, "team" of a team_event, "commitment" of a phase_secret, "phase"
// of a phase_event, "config" of a board_config, "rejudge" of a rejudge_event. Called in the
// transaction that wrote the row, after everything that the entry tells. Does nothing for what is
// not public: practice, re-runs, what has not ended. Internal to the store; throws
// SQLite::Exception.
void AppendEntry(SQLite::Database& db, const std::string& kind, int64_t row);

}  // namespace myograde::server
