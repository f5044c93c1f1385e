// Why an episode was not played to its end.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/base/outcome.h"

namespace myograde {

struct FaultEvidence {
  Outcome outcome = Outcome::kGraderError;  // the participant's fault or the grader's
  std::string limit;      // config key of the broken limit, "" if none
  double limit_value = 0;  // the limit, in the unit that its key names
  double value = 0;        // the measured value, in the same unit
  int64_t step = -1;       // control step being played, -1 before the first
  std::string detail;      // one sentence: what, where, what to do
  std::string stderr_tail;  // the last 4 KiB of this run's stderr, printable
};

}  // namespace myograde
