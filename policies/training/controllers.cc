// The baselines' controllers for Python's ctypes: the search steps the very code that is submitted.
// A handle belongs to one environment; numbers are contiguous doubles of the caller.
#include <algorithm>
#include <cstddef>
#include <span>

#include "policies/baseline/juggler.h"
#include "policies/baseline/reacher.h"
#include "policies/baseline/reacher_parameters.h"
#include "policies/baseline/tagger.h"
#include "policies/baseline/walker.h"

using myograde::baseline::Juggler;
using myograde::baseline::JugglerParameters;
using myograde::baseline::kHandActions;
using myograde::baseline::kJugglerObservation;
using myograde::baseline::kReacherAction;
using myograde::baseline::kReacherObservation;
using myograde::baseline::kWalkerAction;
using myograde::baseline::kWalkerObservation;
using myograde::baseline::kWalkerParameters;
using myograde::baseline::kWholeMuscles;
using myograde::baseline::kWholeObservation;
using myograde::baseline::MakePlan;
using myograde::baseline::ObservedIn;
using myograde::baseline::ParameterInfo;
using myograde::baseline::Reacher;
using myograde::baseline::ReacherParameters;
using myograde::baseline::Tagger;
using myograde::baseline::TaggerParameters;
using myograde::baseline::Walker;
using myograde::baseline::WalkerNumbers;

namespace {

// start, deviation, low, high
void CopyInfo(const ParameterInfo& info, double* out) {
  const double values[] = {info.start, info.deviation, info.low, info.high};
  std::copy(std::begin(values), std::end(values), out);
}

}  // namespace

extern "C" {

size_t walker_parameter_count() { return kWalkerParameters.size(); }
const char* walker_parameter_name(size_t i) { return kWalkerParameters[i].name; }
void walker_parameter_info(size_t i, double* out) { CopyInfo(kWalkerParameters[i], out); }

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

size_t reacher_parameter_count() { return ReacherParameters().size(); }
const char* reacher_parameter_name(size_t i) { return ReacherParameters()[i].name; }
void reacher_parameter_info(size_t i, double* out) { CopyInfo(ReacherParameters()[i], out); }

void* reacher_make(const double* numbers) {
  return new Reacher(MakePlan({numbers, ReacherParameters().size()}));
}
void reacher_free(void* reacher) { delete static_cast<Reacher*>(reacher); }
void reacher_reset(void* reacher) { static_cast<Reacher*>(reacher)->Reset(); }
void reacher_act(void* reacher, const double* observation, double* action) {
  static_cast<Reacher*>(reacher)->Act(
      std::span<const double, kReacherObservation>(observation, kReacherObservation),
      std::span<double, kReacherAction>(action, kReacherAction));
}

size_t juggler_parameter_count() { return JugglerParameters().size(); }
const char* juggler_parameter_name(size_t i) { return JugglerParameters()[i].name; }
void juggler_parameter_info(size_t i, double* out) { CopyInfo(JugglerParameters()[i], out); }
void* juggler_make(const double* numbers) {
  return new Juggler({numbers, JugglerParameters().size()});
}
void juggler_free(void* juggler) { delete static_cast<Juggler*>(juggler); }
void juggler_reset(void* juggler) { static_cast<Juggler*>(juggler)->Reset(); }
void juggler_act(void* juggler, const double* observation, double* action) {
  static_cast<Juggler*>(juggler)->Act(
      std::span<const double, kJugglerObservation>(observation, kJugglerObservation),
      std::span<double, kHandActions>(action, kHandActions));
}

size_t tagger_parameter_count() { return TaggerParameters().size(); }
const char* tagger_parameter_name(size_t i) { return TaggerParameters()[i].name; }
void tagger_parameter_info(size_t i, double* out) { CopyInfo(TaggerParameters()[i], out); }
void* tagger_make(const double* numbers) {
  return new Tagger({numbers, TaggerParameters().size()});
}
void tagger_free(void* tagger) { delete static_cast<Tagger*>(tagger); }
void tagger_reset(void* tagger) { static_cast<Tagger*>(tagger)->Reset(); }
void tagger_act(void* tagger, const double* observation, double* action) {
  static_cast<Tagger*>(tagger)->Act(
      std::span<const double, kWholeObservation>(observation, kWholeObservation),
      std::span<double, kWholeMuscles>(action, kWholeMuscles));
}

}  // extern "C"
