// What the golden tests of the manipulation track compare, and how closely.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "sim/environment.h"
#include "tests/sim/golden.h"
#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {

// Draws, and what is basic arithmetic on them, are compared to the last bit.
// Where physics is not stepped, both sides evaluate the same formulas in
// another order of operations: a few units in the last place of numbers up to
// 1e3, so 1e-12; 1e-9 where a solver's result (accelerations, forces) is scaled.
inline constexpr double kFormula = 1e-12;
inline constexpr double kSolver = 1e-9;
// The solver stops once a turn gains less than 1e-8. From a recorded state on
// its own it starts at the recorded answer, and may take the turn that the
// official one left out (seen: 2 of 4,200 states, where contact forces then
// differ in their fifth digit and accelerations by 2e-6 of the largest). Steps
// start as the official ones did and are held to the bounds below.
inline constexpr double kSolverRestart = 1e-5;
inline constexpr double kForceRestart = 1e-3;
// The recorded vector is rounded to single precision.
inline constexpr double kSinglePrecision = 1.2e-7;
// Stepping: the two versions of MuJoCo order a few sums differently. With the
// recordings of tests/golden positions differ by 6e-15 after 20 control steps,
// with wild random actions by 2e-13; the bounds are far below any real
// difference (wrong inertials: 6e-3, wrong muscle gain: 2e-2). A box that
// tumbles between contacts lets differences grow without limit, so what comes
// after 20 steps is followed up to a difference of 1e-9 and then left to the
// single steps. Velocities change a thousand times faster than positions.
struct Bounds {
  double position;
  double velocity;
};
inline constexpr int kStrictSteps = 20;
inline constexpr Bounds kStrict = {1e-12, 1e-9};
inline constexpr Bounds kSingleStep = {1e-11, 1e-8};
inline constexpr Bounds kLong = {1e-9, 1e-6};
inline constexpr double kForce = 1e-9;  // relative

// The official action of step t where a file does not hold it: sin(0.1 t + i).
std::vector<double> SineAction(int t);

// True for recordings of this track's environment.
bool IsManipulation(const GoldenFile& file);

// What a reset drew and what it did to the model.
void CompareVariation(GoldenTable& table, ManipulationEnvironment& env,
                      const nlohmann::json& want, const std::string& where);

// The derived entries of the official dictionary, and the object's contacts.
void CompareDictionary(GoldenTable& table, ManipulationEnvironment& env,
                       const nlohmann::json& want, double tolerance, const std::string& prefix,
                       const std::string& where);

// What a policy is shown by name, and all terms of the reward. `history`: the environment has
// played the episode, so that what depends on earlier frames is compared too.
void CompareShownAndTerms(GoldenTable& table, ManipulationEnvironment& env,
                          const nlohmann::json& record, Bounds bounds, bool history,
                          const std::string& prefix, const std::string& where);

void CompareReward(GoldenTable& table, ManipulationEnvironment& env, const nlohmann::json& want,
                   double tolerance, const std::string& prefix, const std::string& where);

// Geoms and distances of all contacts, in an order of their own.
void CompareContacts(GoldenTable& table, ManipulationEnvironment& env,
                     const nlohmann::json& want, double tolerance, const std::string& prefix,
                     const std::string& where);

void CompareState(GoldenTable& table, ManipulationEnvironment& env, const nlohmann::json& want,
                  Bounds bounds, const std::string& prefix, const std::string& where);

// How a file says what was done in a step: the action itself (RecordedAction), the
// formula, or else the controls (which then go in directly).
StepResult PlayRecorded(ManipulationEnvironment& env, const nlohmann::json& file,
                        const nlohmann::json& step, int t);

// A box that was drawn larger is looked for in its nominal bounds by the
// official MuJoCo, which then misses contacts with it; no other version does.
// So a comparison of an enlarged box ends when it may touch something: the
// pillar that it falls on if it grew along its upright axis (y in its frame),
// a hand if it grew at all. A taller box can also bounce off within a single
// control step, which no touch at its ends shows: see FellThrough.
class Comparable {
 public:
  explicit Comparable(const ManipulationEnvironment& env) {
    const auto& nominal = env.rules().half_size_m;
    for (int i = 0; i < 3; ++i) larger_ = larger_ || env.variation().half_size[i] > nominal[i];
    taller_ = env.variation().half_size[1] > nominal[1];
  }

  bool operator()(ManipulationEnvironment& env) {
    const bool pillar = env.touch()[kTouchStart] || env.touch()[kTouchGoal];
    const bool hand = env.touch()[kTouchArm] || env.touch()[kTouchProsthesis];
    comparable_ = comparable_ && !(taller_ && (pillar || hand)) && !(larger_ && hand) &&
                  !AnyMeshTouches(env);
    return comparable_;
  }
  bool value() const { return comparable_; }
  bool taller() const { return taller_; }

 private:
  bool larger_ = false;
  bool taller_ = false;
  bool comparable_ = true;
};

// Whether nothing but gravity changed the box's vertical velocity in the step
// between two recorded states, and in ours, which began at the first of them
// and is in `env` now. A bounce changes it by some 1e-1 m/s.
bool FellThrough(ManipulationEnvironment& env, const nlohmann::json& before,
                 const nlohmann::json& after);

}  // namespace myograde::sim
