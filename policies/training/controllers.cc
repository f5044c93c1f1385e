// The baselines' controllers for Python's ctypes: the search steps the very code that is submitted.
// A handle belongs to one environment; numbers are contiguous doubles of the caller.
#include <algorithm>
#include <cstddef>
#include <exception>
#include <span>

#include "policies/baseline/reacher.h"
#include "policies/baseline/walker.h"

using myograde::baseline::kLegModes;
using myograde::baseline::kWalkerAction;
using myograde::baseline::kWalkerObservation;
using myograde::baseline::kWalkerParameters;
using myograde::baseline::Walker;
using myograde::baseline::WalkerNumbers;

extern "C" {

size_t walker_parameter_count() { return kWalkerParameters.size(); }
const char* walker_parameter_name(size_t i) { return kWalkerParameters[i].name; }
// start, deviation, low, high
void walker_parameter_info(size_t i, double* out) {
  const auto& info = kWalkerParameters[i];
  const double values[] = {info.start, info.deviation, info.low, info.high};
  std::copy(std::begin(values), std::end(values), out);
}

void* walker_make(const double* numbers) {
  WalkerNumbers copy;
  std::copy_n(numbers, copy.size(), copy.begin());
  return new Walker(copy);
}
void walker_free(void* walker) { delete static_cast<Walker*>(walker); }
void walker_reset(void* walker) { static_cast<Walker*>(walker)->Reset(); }
void walker_act(void* walker, const double* observation, double* action) {
  static_cast<Walker*>(walker)->Act(
      std::span<const double, kWalkerObservation>(observation, kWalkerObservation),
      std::span<double, kWalkerAction>(action, kWalkerAction));
}
// Six numbers for each of the leg's five sets: knee stiffness, damping and target, then the
// ankle's.
void walker_leg_modes(void* walker, double* out) {
  for (const auto& mode : static_cast<Walker*>(walker)->LegModes()) {
    for (const double value : {mode.knee_stiffness, mode.knee_damping, mode.knee_target,
                               mode.ankle_stiffness, mode.ankle_damping, mode.ankle_target}) {
      *out++ = value;
    }
  }
}

// The plan in the file `path`; null if there is none that can be used.
void* reacher_make(const char* path) {
  try {
    return new myograde::baseline::Reacher(myograde::baseline::ReadReacherPlan(path));
  } catch (const std::exception&) {
    return nullptr;
  }
}
void reacher_free(void* reacher) { delete static_cast<myograde::baseline::Reacher*>(reacher); }
void reacher_reset(void* reacher) { static_cast<myograde::baseline::Reacher*>(reacher)->Reset(); }
void reacher_act(void* reacher, const double* observation, double* action) {
  using myograde::baseline::kReacherAction;
  using myograde::baseline::kReacherObservation;
  static_cast<myograde::baseline::Reacher*>(reacher)->Act(
      std::span<const double, kReacherObservation>(observation, kReacherObservation),
      std::span<double, kReacherAction>(action, kReacherAction));
}

}  // extern "C"
