// Boards as the store knows them: which config each had, and what stands on one at a moment.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace SQLite {
class Database;
}

namespace myograde::server {

// The board of a phase or, if `phase` is "", of a track's profile. (The boards of scoring, "main" and
// others, are different orders of the same entries.)
struct BoardName {
  std::string phase;
  std::string track;
  std::string profile;

  auto operator<=>(const BoardName&) const = default;
};

// From then on the board had this config.
struct BoardConfigRow {
  int64_t id = 0;
  int64_t at = 0;
  BoardName board;
  std::string config;   // its hash
  int64_t rejudge = 0;  // whose act it was; 0: the config files changed
  std::string who;
  std::string from_config;  // of that rejudge; "": none
};

// The config that a board has from now on.
struct NewBoardConfig {
  BoardName board;
  std::string config;            // hash
  std::string config_json = "";  // canonical; "": the store has it
  int64_t rejudge = 0;           // whose act it is; 0: the config files changed
};

// What the newest of a board's rows says; nullopt: it has none. Internal to the store; throws
// SQLite::Exception.
std::optional<std::string> NewestBoardConfig(SQLite::Database& db, const BoardName& board);

// As of when a board is asked for. What happened from `before_ms` on is left out.
struct BoardMoment {
  int64_t before_ms = INT64_MAX;
  // A freeze: results, choices and rejudges from then on are left out, while marks count.
  int64_t freeze_ms = INT64_MAX;
  // The id of a rejudge that counts as applied, after all others; 0: none.
  int64_t assumed_rejudge = 0;

  int64_t results_before_ms() const { return before_ms < freeze_ms ? before_ms : freeze_ms; }
};

// Ranked submissions of a board that stand under another config than the one asked about.
struct OtherConfig {
  std::string config;       // its hash
  int64_t submissions = 0;  // that have a result under it
  int64_t teams = 0;
  int64_t first_at = 0;     // when the earliest and the latest of them were accepted
  int64_t last_at = 0;
};

// A result that has ended. `done`: it may stand on a board.
struct EndedResult {
  int64_t submission = 0;
  int64_t evaluation = 0;
  bool done = false;
};

// The evaluation by which each submission stands on a board: its own, in whose place each applied
// rejudge, the earliest first, puts the one that it ended with. One that ended without a result takes
// the submission off. Pure, as is StandingChoices: the store and the check of the public record share
// them, so that both have the same board.
std::map<int64_t, int64_t> EvaluationsInForce(
    const std::vector<EndedResult>& originals,
    const std::vector<std::vector<EndedResult>>& rejudges);

// That a team chose a submission to stand with.
struct TeamChoice {
  int64_t team = 0;        // in force
  int64_t submission = 0;
  bool of_board = false;   // the submission is under the board's config
  bool rejudged = false;   // an applied rejudge has ended for it, with a result or without
};

// The submission that each team stands with where teams choose: its newest choice of those that
// belong to the board. If that one has no result, the team is not on the board. `choices`: the oldest
// first.
std::set<int64_t> StandingChoices(const std::vector<TeamChoice>& choices);

// What a rejudge has to do with an evaluation.
struct RejudgeSight {
  int64_t rejudge = 0;        // its id; 0: none
  bool ever_applied = false;  // its results stood on a board, if they do not still
  bool revealed = false;      // it has further episodes, and the seeds of its phase are revealed
};

}  // namespace myograde::server
