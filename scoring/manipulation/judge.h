// From the facts of an episode of manipulation to its verdict and its metrics.
#pragma once

#include <cstdint>

#include "scoring/verdict.h"

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

struct ManipulationJudging {
  SuccessRule success = SuccessRule::kPlaced;
  int64_t contact_frames = 100;  // control steps of 0.01 s, for each limb
  bool force_enforced = true;
  double force_limit_n = 1500;   // a larger peak force is a failure
  TimeSource time = TimeSource::kPlayed;  // a failure counts full_time_s
  double full_time_s = 10;       // s, counted for failures and the participant's faults
  // What a phantom episode failed by, where nothing irreparable came first.
  FailureReason phantom = ManipulationReason::kPhantom;
};

// Places of the metrics in Verdict::metrics and in the track's list.
struct ManipulationMetric {
  enum Place : size_t {
    kTime,          // s
    kEffort,        // mean over the steps; none without a step
    kEffortSum,     // the official code's sum over the steps
    kReportedTime,  // s, the official code's time: 10 after a drop
    kPeakForce,     // N
    kMaxTouch,      // N, the official code's peak
    kEffortOverSteps,
    kCount,
  };
};

// Judges an episode. The first cause wins, as far as the facts tell the order:
//  1. a fault, with the outcome that its evidence names;
//  2. what no later step can mend, and so came no later than the episode's end: force
//     (if enforced), then contact with what must not be touched (unless the rule is kSolved;
//     between these two the facts keep no order, and force, the rule of safety, goes first);
//  3. how the episode ended: dropped, time or as a phantom, where the goal was not reached;
//  4. what is only known at the end: handover (a limb touched for too short, or the goal was
//     not held).
//
// An episode without a usable end for its track (grader's fault: facts that contradict
// themselves) is kGraderError. Numbers in `facts` are finite.
Verdict Judge(const EpisodeFacts& facts, const ManipulationJudging& rules);

}  // namespace myograde::scoring
