#include "sim/locomotion/leg.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::sim {
namespace {

// Mass of person and leg as the official controller takes it, kg.
constexpr double kBodyMass = 78.66887849930261;
constexpr double kBodyWeight = kBodyMass * 9.81;

constexpr auto kUnused = static_cast<uint8_t>(ThresholdKind::kUnused);
constexpr auto kAbove = static_cast<uint8_t>(ThresholdKind::kAbove);
constexpr auto kBelow = static_cast<uint8_t>(ThresholdKind::kBelow);

constexpr std::array<const char*, kLegQuantities> kQuantityNames = {
    "load", "knee_angle", "knee_velocity", "ankle_angle", "ankle_velocity"};

LegStateParameters MakeState(const LegStateRules& rules) {
  LegStateParameters out{};
  out.knee_stiffness = rules.knee.stiffness;
  out.knee_damping = rules.knee.damping;
  out.knee_target = Radians(rules.knee.target_deg);
  out.ankle_stiffness = rules.ankle.stiffness;
  out.ankle_damping = rules.ankle.damping;
  out.ankle_target = Radians(rules.ankle.target_deg);
  for (int q = 0; q < kLegQuantities; ++q) {
    const LegThreshold& until = rules.until[q];
    if (until.kind == ThresholdKind::kUnused) continue;
    out.threshold_kind[q] = static_cast<uint8_t>(until.kind);
    out.threshold[q] = q == kLoad ? until.value * kBodyWeight : Radians(until.value);
  }
  return out;
}

LegSet MakeDefaultSet() {
  LegSetRules set = {.name = "default",
                     .states = {{{{99.372, 3.180, 5}, {19.874, 0, -2}, {}},
                                 {{99.372, 1.272, 8}, {79.498, 0.063, -20}, {}},
                                 {{39.749, 0.063, 60}, {7.949, 0, 25}, {}},
                                 {{15.899, 3.816, 5}, {7.949, 0, 15}, {}}}}};
  set.states[0].until[kLoad] = {ThresholdKind::kAbove, 0.25};
  set.states[0].until[kAnkleAngle] = {ThresholdKind::kAbove, 6};
  set.states[1].until[kLoad] = {ThresholdKind::kBelow, 0.15};
  set.states[2].until[kKneeAngle] = {ThresholdKind::kAbove, 50};
  set.states[2].until[kKneeVelocity] = {ThresholdKind::kBelow, 3};
  set.states[3].until[kLoad] = {ThresholdKind::kAbove, 0.4};
  set.states[3].until[kKneeAngle] = {ThresholdKind::kBelow, 30};
  return MakeLegSet(set);
}

// Tells the first number of an uploaded state that is out of its range.
class StateCheck {
 public:
  StateCheck(int set, int state) : set_(set), state_(state) {}

  void Range(const char* name, double value, double low, double high, const char* unit) {
    if (!status_.ok() || (value >= low && value <= high)) return;  // false for NaN
    Fail(absl::StrCat(name, " is ", value, ", must be from ", low, " to ", high, " ", unit));
  }
  void Fail(const std::string& problem) {
    if (!status_.ok()) return;
    status_ = absl::InvalidArgumentError(
        absl::StrCat("leg parameter set ", set_, ", state ",
                     LegStateName(static_cast<LegState>(state_)), ": ", problem));
  }
  const absl::Status& status() const { return status_; }

 private:
  int set_;
  int state_;
  absl::Status status_;
};

absl::Status CheckState(const LegStateParameters& p, const LegRules& rules, int set, int state) {
  StateCheck check(set, state);
  check.Range("knee_stiffness", p.knee_stiffness, 0, rules.max_stiffness, "N m/rad");
  check.Range("knee_damping", p.knee_damping, 0, rules.max_damping, "N m s/rad");
  check.Range("knee_target", p.knee_target, kLegKneeLow, kLegKneeHigh, "rad");
  check.Range("ankle_stiffness", p.ankle_stiffness, 0, rules.max_stiffness, "N m/rad");
  check.Range("ankle_damping", p.ankle_damping, 0, rules.max_damping, "N m s/rad");
  check.Range("ankle_target", p.ankle_target, kLegAnkleLow, kLegAnkleHigh, "rad");
  bool can_leave = false;
  for (int q = 0; q < kLegQuantities; ++q) {
    if (p.threshold_kind[q] > kBelow) {
      check.Fail(absl::StrCat("threshold of ", kQuantityNames[q], " has the unknown kind ",
                              int{p.threshold_kind[q]}));
    }
    if (p.threshold_kind[q] == kUnused) continue;
    can_leave = true;
    if (!std::isfinite(p.threshold[q])) {
      check.Fail(absl::StrCat("threshold of ", kQuantityNames[q], " is ", p.threshold[q],
                              ", must be a finite number"));
    }
  }
  if (!can_leave) check.Fail("has no threshold, must have at least one to leave the state");
  return check.status();
}

bool Leaves(const LegStateParameters& p, const std::array<double, kLegQuantities>& sensed) {
  for (int q = 0; q < kLegQuantities; ++q) {
    if (p.threshold_kind[q] == kAbove && sensed[q] > p.threshold[q]) return true;
    if (p.threshold_kind[q] == kBelow && sensed[q] < p.threshold[q]) return true;
  }
  return false;
}

double Clip(double value, double limit) { return std::clamp(value, -limit, limit); }

}  // namespace

const LegSet& DefaultLegSet() {
  static const LegSet set = MakeDefaultSet();
  return set;
}

LegSet MakeLegSet(const LegSetRules& rules) {
  LegSet set;
  for (int i = 0; i < kLegStates; ++i) set[i] = MakeState(rules.states[i]);
  return set;
}

LegController::LegController() {
  first_sets_.fill(DefaultLegSet());
  Reset();
}

LegController::LegController(const LegRules& rules) : LegController() {
  for (size_t i = 0; i < rules.parameter_sets.size(); ++i) {
    first_sets_[i] = MakeLegSet(rules.parameter_sets[i]);
  }
  Reset();
}

void LegController::Reset() {
  sets_ = first_sets_;
  state_ = LegState::kEarlyStance;
  Select(0);
}

absl::Status LegController::Upload(const LegParameterSets& sets, const LegRules& rules) {
  for (int i = 0; i < kLegSets; ++i) {
    if ((sets.present >> i & 1u) == 0) continue;
    if (i >= rules.sets) {
      return absl::InvalidArgumentError(
          absl::StrCat("leg parameter set ", i, " does not exist in this profile, ",
                       "which has sets 0 to ", rules.sets - 1));
    }
    for (int state = 0; state < kLegStates; ++state) {
      RETURN_IF_ERROR(CheckState(sets.set[i][state], rules, i, state));
    }
  }
  for (int i = 0; i < kLegSets; ++i) {
    if ((sets.present >> i & 1u) == 0) continue;
    std::copy(std::begin(sets.set[i]), std::end(sets.set[i]), sets_[i].begin());
  }
  return absl::OkStatus();
}

void LegController::Select(int set) {
  selected_ = set;
  acting_ = sets_[set];
}

LegTorques LegController::Update(const LegSensors& sensors) {
  const std::array<double, kLegQuantities> sensed = {sensors.load, sensors.knee_angle,
                                                     sensors.knee_velocity, sensors.ankle_angle,
                                                     sensors.ankle_velocity};
  if (Leaves(acting_[static_cast<size_t>(state_)], sensed)) {
    state_ = static_cast<LegState>((static_cast<int>(state_) + 1) % kLegStates);
  }
  const LegStateParameters& p = acting_[static_cast<size_t>(state_)];
  const double knee = p.knee_stiffness * (p.knee_target - sensors.knee_angle) -
                      p.knee_damping * sensors.knee_velocity;
  const double ankle = p.ankle_stiffness * (p.ankle_target - sensors.ankle_angle) -
                       p.ankle_damping * sensors.ankle_velocity;
  return {Clip(knee, kLegKneeGear * kLegMotorLimit), Clip(ankle, kLegAnkleGear * kLegMotorLimit)};
}

const char* LegStateName(LegState state) {
  return kLegStateKeys[static_cast<size_t>(state)];
}

}  // namespace myograde::sim
