// The controller of the baseline of the track chasetag: the walker (walker.h) on two whole legs
// heads for the opponent, or for the edge of the field, where an opponent does not come.
#pragma once

#include <span>
#include <vector>

#include "policies/baseline/walker.h"

namespace myograde::baseline {

// What a search may change: numbers of the walker, those of both legs alike, and the tagger's own.
std::span<const ParameterInfo> TaggerParameters();

class Tagger {
 public:
  // `numbers`: in the order of TaggerParameters().
  explicit Tagger(std::span<const double> numbers);

  // Before the first observation of an episode.
  void Reset();
  // Direct actions: excitations in [0, 1].
  void Act(std::span<const double, kWholeObservation> observation,
           std::span<double, kWholeMuscles> action);

 private:
  void SeeTask(double speed);
  double Heading(std::span<const double, kWholeObservation> observation) const;

  std::vector<double> own_;  // the numbers that are not the walker's
  Walker walker_;
  int seen_ = 0;         // observations of the episode
  bool evades_ = false;  // the task, as far as it is known
  double speed_ = 0;     // m/s, of the opponent in the last observation
  double heading_ = 0;   // rad, that the walker has to turn to
};

}  // namespace myograde::baseline
