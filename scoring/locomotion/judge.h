// From the facts of an episode of locomotion to its verdict and its metrics.
#pragma once

#include "scoring/verdict.h"

namespace myograde::scoring {

struct LocomotionJudging {
  TimeSource time = TimeSource::kPlayed;
  double full_time_s = 300;  // s, counted for the participant's faults
  double course_m = 100;     // m, what a finished episode has walked
};

// Places of the metrics in Verdict::metrics and in the track's list.
struct LocomotionMetric {
  enum Place : size_t {
    kDistance,      // m
    kTime,          // s
    kEffort,        // mean over the steps; none without a step
    kPain,          // mean over the steps; none without a step
    kEffortSum,     // the official code's sums over the steps
    kPainSum,
    kReportedTime,  // s, the official code's time: 300 after a fall
    kEffortOverSteps,
    kPainOverSteps,
    kCount,
  };
};

// Judges an episode: finished is success; otherwise a fault or the end names the reason.
//
// An episode without a usable end for its track (grader's fault: facts that contradict
// themselves) is kGraderError. Numbers in `facts` are finite.
Verdict Judge(const EpisodeFacts& facts, const LocomotionJudging& rules);

}  // namespace myograde::scoring
