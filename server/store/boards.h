// Boards as the store knows them: which config each had, and what stands on one at a moment.
#pragma once

#include <cstdint>
#include <string>

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

// What a rejudge has to do with an evaluation.
struct RejudgeSight {
  int64_t rejudge = 0;        // its id; 0: none
  bool ever_applied = false;  // its results stood on a board, if they do not still
  bool revealed = false;      // it has further episodes, and the seeds of its phase are revealed
};

}  // namespace myograde::server
