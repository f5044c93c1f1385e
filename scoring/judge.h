// From the facts of one episode to its verdict and its metrics.
#pragma once

#include <cstdint>
#include <optional>

#include "protocol/base/episode_facts.h"
#include "protocol/base/outcome.h"

namespace myograde::scoring {

// What makes a manipulation episode a success.
enum class SuccessRule {
  // The episode ended because the object was placed; each limb had touched it for
  // `contact_frames`; nothing else had.
  kPlaced,
  // The official flag at the last step, and the official verdict on the contacts:
  // the limbs' frames, nothing else touched, only the goal at the end.
  kSolvedAndContact,
  // The official flag at the last step alone.
  kSolved,
};

// Where the time of an episode that was played to its end comes from.
enum class TimeSource {
  kPlayed,    // simulated time; a failed manipulation episode counts full_time_s
  kReported,  // what the official code reports (10 s after a drop, 300 s after a fall)
};

struct ManipulationJudging {
  SuccessRule success = SuccessRule::kPlaced;
  int64_t contact_frames = 100;  // control steps of 0.01 s, for each limb
  bool force_enforced = true;
  double force_limit_n = 1500;   // a larger peak force is a failure
  TimeSource time = TimeSource::kPlayed;
  double full_time_s = 10;       // s, counted for failures and the participant's faults
  // What a phantom episode failed by, where nothing irreparable came first.
  FailureReason phantom = FailureReason::kPhantom;
};

struct LocomotionJudging {
  TimeSource time = TimeSource::kPlayed;
  double full_time_s = 300;  // s, counted for the participant's faults
  double course_m = 100;     // m, what a finished episode has walked
};

// One episode's numbers, each in the unit of its name's comment.
struct Metrics {
  double time = 0;               // s
  std::optional<double> effort = std::nullopt;  // mean over the steps; none without a step
  std::optional<double> pain = std::nullopt;    // mean over the steps; locomotion only
  double distance = 0;           // m; locomotion only
  // Shown beside the ranked numbers, never ranked.
  double effort_sum = 0;         // the official code's sums over the steps
  double pain_sum = 0;
  double reported_time = 0;      // s, the official code's time
  double peak_force = 0;         // N; manipulation only
  std::optional<double> max_touch = std::nullopt;  // N, the official code's peak; manipulation only
  int64_t steps = 0;             // control steps, which effort and pain are means over
};

struct Judgement {
  Outcome outcome = Outcome::kGraderError;
  FailureReason reason = FailureReason::kNone;
  Metrics metrics;
};

// Judges an episode of a track. The first cause wins, as far as the facts tell the order:
//  1. a fault, with the outcome that its evidence names;
//  2. what no later step can mend, and so came no later than the episode's end: force
//     (if enforced), then contact with what must not be touched (unless the rule is kSolved;
//     between these two the facts keep no order, and force, the rule of safety, goes first);
//  3. how the episode ended: dropped, time or as a phantom, where the goal was not reached;
//  4. what is only known at the end: handover (a limb touched for too short, or the goal was
//     not held).
// Locomotion: finished is success; otherwise the end names the reason.
//
// An episode without a usable end for its track (grader's fault: facts that contradict
// themselves) is kGraderError. Numbers in `facts` are finite.
Judgement Judge(const EpisodeFacts& facts, const ManipulationJudging& rules);
Judgement Judge(const EpisodeFacts& facts, const LocomotionJudging& rules);

}  // namespace myograde::scoring
