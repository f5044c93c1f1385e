// The baselines' controllers for Python's ctypes: the search steps the very code that is submitted.
// A handle belongs to one environment; numbers are contiguous doubles of the caller.
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <span>
#include <vector>

#include "policies/baseline/carrier.h"
#include "policies/baseline/juggler.h"
#include "policies/baseline/reacher.h"
#include "policies/baseline/reacher_parameters.h"
#include "policies/baseline/tagger.h"
#include "policies/baseline/turner.h"
#include "policies/baseline/walker.h"

using myograde::baseline::Carrier;
using myograde::baseline::CarrierParameters;
using myograde::baseline::Juggler;
using myograde::baseline::JugglerParameters;
using myograde::baseline::kArmMuscles;
using myograde::baseline::kCarrierObservation;
using myograde::baseline::kHandActions;
using myograde::baseline::kJugglerObservation;
using myograde::baseline::kReacherAction;
using myograde::baseline::kReacherObservation;
using myograde::baseline::kTurnerObservation;
using myograde::baseline::kWalkerAction;
using myograde::baseline::kWalkerObservation;
using myograde::baseline::kWalkerParameters;
using myograde::baseline::kWholeMuscles;
using myograde::baseline::kWholeObservation;
using myograde::baseline::MakeCarrierPlan;
using myograde::baseline::MakePlan;
using myograde::baseline::MakeTurn;
using myograde::baseline::ObservedIn;
using myograde::baseline::ParameterInfo;
using myograde::baseline::Reacher;
using myograde::baseline::ReacherParameters;
using myograde::baseline::ReadTurns;
using myograde::baseline::Tagger;
using myograde::baseline::TaggerParameters;
using myograde::baseline::Turn;
using myograde::baseline::Turner;
using myograde::baseline::TurnParameters;
using myograde::baseline::Walker;
using myograde::baseline::WalkerNumbers;

namespace {

// start, deviation, low, high
void CopyInfo(const ParameterInfo& info, double* out) {
  const double values[] = {info.start, info.deviation, info.low, info.high};
  std::copy(std::begin(values), std::end(values), out);
}

WalkerNumbers Numbers(std::span<const double> numbers) {
  WalkerNumbers copy;
  std::ranges::copy(numbers, copy.begin());
  return copy;
}

std::vector<Turn> OnlyTurn(std::span<const double> numbers) { return {MakeTurn(numbers)}; }

}  // namespace

// The functions of one controller; `from`: what makes its constructor's argument of the numbers.
#define CONTROLLER(prefix, Type, parameters, from, observation_size, action_size)              \
  size_t prefix##_parameter_count() { return parameters.size(); }                              \
  const char* prefix##_parameter_name(size_t i) { return parameters[i].name; }                 \
  void prefix##_parameter_info(size_t i, double* out) { CopyInfo(parameters[i], out); }        \
  void* prefix##_make(const double* numbers) {                                                 \
    return new Type(from(std::span(numbers, parameters.size())));                              \
  }                                                                                            \
  void prefix##_free(void* controller) { delete static_cast<Type*>(controller); }              \
  void prefix##_reset(void* controller) { static_cast<Type*>(controller)->Reset(); }           \
  void prefix##_act(void* controller, const double* observation, double* action) {             \
    static_cast<Type*>(controller)->Act(                                                       \
        std::span<const double, observation_size>(observation, observation_size),              \
        std::span<double, action_size>(action, action_size));                                  \
  }

extern "C" {

CONTROLLER(walker, Walker, kWalkerParameters, Numbers, kWalkerObservation, kWalkerAction)
// The profile whose observations the next ones are.
void walker_expect(void* walker, const char* profile) {
  static_cast<Walker*>(walker)->Expect(ObservedIn(profile));
}
// Six numbers for each of the leg's four sets: knee stiffness, damping and target, then the
// ankle's.
void walker_leg_modes(void* walker, double* out) {
  for (const auto& mode : static_cast<Walker*>(walker)->LegModes()) {
    for (const double value : {mode.knee_stiffness, mode.knee_damping, mode.knee_target,
                               mode.ankle_stiffness, mode.ankle_damping, mode.ankle_target}) {
      *out++ = value;
    }
  }
}

CONTROLLER(reacher, Reacher, ReacherParameters(), MakePlan, kReacherObservation, kReacherAction)
CONTROLLER(carrier, Carrier, CarrierParameters(), MakeCarrierPlan, kCarrierObservation, kArmMuscles)
CONTROLLER(juggler, Juggler, JugglerParameters(), std::span, kJugglerObservation, kHandActions)
CONTROLLER(tagger, Tagger, TaggerParameters(), std::span, kWholeObservation, kWholeMuscles)
CONTROLLER(turner, Turner, TurnParameters(), OnlyTurn, kTurnerObservation, kHandActions)
// With the turns of a file; null, and why, if it is not one.
void* turner_open(const char* path, char* reason, size_t size) {
  try {
    return new Turner(ReadTurns(path));
  } catch (const std::exception& error) {
    std::snprintf(reason, size, "%s", error.what());
    return nullptr;
  }
}

}  // extern "C"
