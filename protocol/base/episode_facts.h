// What the simulator measured in one episode: facts only, no judgement. The
// code in scoring/ turns them into an outcome and metrics, so new rules can
// score old episodes without simulating them again.
#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include "protocol/base/outcome.h"

namespace myograde {

// How the simulator saw the episode come to its end.
enum class EpisodeEnd {
  kTime,      // the episode's simulated time was over
  kPlaced,    // manipulation: the end condition of the profile was met
  kDropped,   // manipulation: object below the drop height
  kFinished,  // locomotion: the end of the course
  kFell,      // locomotion
  kOffTrack,  // locomotion
  kPhantom,   // as-graded only: ended by the previous episode's stale flag (D18)
  kGivenUp,   // the policy asked to end it here
  kFault,     // not played to its end: see EpisodeFacts::fault
};

std::string_view EpisodeEndName(EpisodeEnd end);  // "time", "placed", ...
std::optional<EpisodeEnd> ParseEpisodeEnd(std::string_view name);

// Evidence of a fault (participant's or grader's). Valid iff end == kFault.
struct FaultEvidence {
  Outcome outcome = Outcome::kGraderError;
  std::string limit;      // config key of the broken limit, "" if none
  double limit_value = 0;  // the limit, in the unit that its key names
  double value = 0;        // what was measured, same unit
  int64_t step = -1;       // control step being played, -1 before the first
  std::string detail;      // one sentence: what, where, what to do
  std::string stderr_tail;  // the last 4 KiB that the policy's run wrote there, printable
};

// Frames are control steps (100 Hz), counted over the episode and including
// the frame of the reset where the profile counts it.
struct ManipulationFacts {
  int64_t frames = 0;             // frames looked at
  int64_t frames_arm = 0;         // object touched the muscle arm
  int64_t frames_prosthesis = 0;
  int64_t frames_start = 0;       // start pillar
  int64_t frames_goal = 0;        // goal pillar
  int64_t frames_other = 0;       // anything else
  bool goal_only_at_end = false;  // last `hold_frames` frames touched exactly the goal pillar
  bool placed = false;            // profile's placement held (paper: all of the last 8 frames)
  bool solved = false;            // the official `solved` flag at the last step
  int64_t solved_steps = 0;       // steps with the official flag
  double peak_force = 0;          // N, total normal force on the object, largest over physics steps
  double max_touch = 0;           // N, official max_force: touch sensor at control rate
  double goal_distance_sum = 0;   // m, summed over steps (official goal_dist)
  double final_goal_distance = 0;       // m, official goal_dist at the end
  double final_hand_distance = 0;       // m, |palm - object| at the end
  double max_height = 0;                // m, largest height of the object above its height at start
  double effort_sum = 0;          // sum over steps of |activations| / 63
  double reported_time = 0;       // s, official reported time (10.0 after a drop)
};

struct LocomotionFacts {
  int course = 0;            // 0 flat, 1 hilly, 2 rough, 3 stairs, 4 mixed
  double distance = 0;       // m, largest progress along the course, in [0, 100]
  double start_y = 0;        // m, where the profile counts distance from
  double min_y = 0;          // m, smallest root y over the steps (before the first: at the start)
  double final_y = 0;        // m
  double effort_sum = 0;     // sum over steps of mean(activation^2)
  double pain_sum = 0;       // sum over steps of mean(clipped limit torque)/1000
  bool solved = false;       // the official flag at the last step
  double reported_time = 0;  // s, official reported time (300.0 after a fall)
};

// Where the log of an episode is found. protocol/episode_log.h is its format.
struct EpisodeLogInfo {
  std::string sha256;        // of the log, unpacked (hex); "": none was kept
  int64_t bytes = 0;         // unpacked
  int64_t packed_bytes = 0;  // as it is stored
  int64_t steps = 0;         // that it holds; fewer than were played if it would be too large
};

struct EpisodeFacts {
  int64_t index = 0;      // number of the episode in the evaluation, from 0
  uint64_t seed = 0;
  EpisodeEnd end = EpisodeEnd::kFault;
  FaultEvidence fault;
  int64_t steps = 0;      // control steps played
  double sim_time = 0;    // s of simulated time at the end
  int64_t clipped = 0;    // action entries clipped to their range
  std::string digest;     // SHA-256 (hex) over the states of every step
  std::string actions_digest;  // the same over the actions, as they were received; "": unknown
  EpisodeLogInfo log;
  std::variant<ManipulationFacts, LocomotionFacts> track;
  // What the host's clock decides: never part of a result's identity.
  double wall_s = 0;
  double policy_cpu_s = 0;
};

}  // namespace myograde
