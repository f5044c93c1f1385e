#include "policies/baseline/walker.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace myograde::baseline {
namespace {

// Offsets in the observation.
constexpr size_t kAngles = 2, kVelocities = 19, kFootForce = 36, kSocketForce = 38, kPelvis = 41,
                 kActivations = 45, kLengths = 99, kMuscleVelocities = 153, kPlace = 261,
                 kPlaceVelocity = 263, kHeights = 265;
// Where each joint of LengthTerms stands among the observation's angles.
constexpr std::array<size_t, kFittedJoints> kJointPlaces = {4, 3, 5, 1, 0, 2, 6, 15, 16, 14};
// The same with two whole legs.
namespace whole {
constexpr size_t kAngles = 0, kVelocities = 28, kFootForce = 56, kPelvis = 60, kPlaceVelocity = 71,
                 kLengths = 73, kMuscleVelocities = 153, kActivations = 313;
constexpr std::array<size_t, kLengthJoints> kJointPlaces = {0,  1,  2,  14, 15, 16, 19,
                                                            22, 23, 24, 5,  8,  9,  10};
}  // namespace whole
// Joints of LengthTerms.
constexpr int kHipRight = 0, kHipLeft = 3;  // flexion; then adduction, rotation
constexpr int kKneeLeft = 6, kKneeRight = 10;  // then ankle, subtalar joint, toes
// The body's size in m, in the pelvis' frame: x forwards, y up, z to the right.
constexpr Vector kHipPlace = {-0.056, -0.078, 0.077};
constexpr Vector kMiddle = {-0.075, 0.04, 0};
constexpr double kThigh = 0.41, kShank = 0.42;
constexpr double kLegKneeGuess = 0.08;  // rad: nothing observes the prosthetic knee

constexpr double kTouch = 30;         // N under the sound foot
constexpr double kSocketTouch = 120;  // N of compression in the socket
constexpr double kHeading = -std::numbers::pi / 2;
constexpr double kApart = 0.1;        // m between the feet of a walking body
constexpr double kLongestStart = 1;   // s
// How far a thigh may swing, rad.
constexpr double kFarthestBack = 0.4, kFarthestAhead = 1.1, kFarthestAcross = 0.2,
                 kFarthestAside = 0.6;
// The height map has 10 rows from 0.9 m before the body on, 0.2 m apart, and as many columns from
// 0.9 m to its left on. A foot lands in these rows.
constexpr size_t kMapSize = 10, kNearestLeft = 4, kNearestRight = 5;
constexpr std::array<size_t, 2> kFootholds = {2, 3};
// The official one has rows from 2.5 m before the body on and columns from 2.5 m to its left on,
// 0.5 m apart. A foot lands near the first of these cells, and the body is over the second.
constexpr size_t kOfficialFoothold = 45, kOfficialUnder = 55;
constexpr double kLargestRise = 0.2;  // m
// How far the body usually is before the sound foot in the prosthesis' swing, m and m/s.
constexpr double kMeanPlace = 0.04, kMeanSpeed = 0.55;
constexpr double kLeadSpeed = 0.6, kLongestLead = 0.25;  // m/s, s
constexpr double kFarAside = 0.7;     // m beside the line
constexpr double kLargestTurn = 0.5;  // rad from the course's direction

double Sign(bool right) { return right ? 1.0 : -1.0; }

}  // namespace

Observed ObservedIn(std::string_view profile) {
  const bool official = profile == "myosuite" || profile == "as-graded";
  return official ? Observed::kOfficial : Observed::kPaper;
}

std::array<LegImpedance, kLegModes> Walker::LegModes() const {
  const LegImpedance stance = {p_[kLegKneeStanceStiffness],  p_[kLegKneeStanceDamping],
                               p_[kLegKneeStance],           p_[kLegAnkleStanceStiffness],
                               p_[kLegAnkleStanceDamping],   p_[kLegAnkleStance]};
  LegImpedance push = stance;
  push.ankle_stiffness = p_[kLegPushStiffness];
  push.ankle_target = p_[kLegPush];
  const double toes_up = p_[kLegAnkleSwingStiffness], toes_damping = toes_up / 30;
  const LegImpedance flex = {p_[kLegKneeSwingStiffness], p_[kLegKneeSwingDamping],
                             p_[kLegKneeSwing],          toes_up,
                             toes_damping,               p_[kLegAnkleSwing]};
  LegImpedance extend = flex;
  extend.knee_stiffness = p_[kLegKneeLandingStiffness];
  extend.knee_damping = p_[kLegKneeLandingDamping];
  extend.knee_target = p_[kLegKneeLanding];
  return {stance, push, flex, extend};
}

void Walker::Reset() {
  muscles_.Reset();
  first_ = true;
}

void Walker::Sense(std::span<const double, kWalkerObservation> observation) {
  const double per_second = observed_ == Observed::kOfficial ? 1 / kControlStep : 1;
  for (int j = 0; j < kFittedJoints; ++j) {
    state_.angles[j] = observation[kAngles + kJointPlaces[j]];
    velocity_[j] = observation[kVelocities + kJointPlaces[j]] * per_second;
  }
  for (int i = 0; i < kMuscles; ++i) {
    state_.activation[i] = observation[kActivations + i];
    state_.length[i] = observation[kLengths + SortedPlaces()[i]];
    state_.velocity[i] = observation[kMuscleVelocities + SortedPlaces()[i]];
  }
  const double beside = observation[kPlace] - p_[kLine];  // m, to the left
  SenseTrunk(observation.subspan<kPelvis, 4>(),
             {observation[kPlaceVelocity], observation[kPlaceVelocity + 1]},
             kHeading - std::clamp(p_[kSteering] * beside, -kLargestTurn, kLargestTurn));
  const double aside = std::clamp(beside, -kFarAside, kFarAside);
  body_.vy += p_[kDrift] * aside;
  body_.vy += p_[kCrab] * body_.vx * std::sin(Wrapped(yaw_ - kHeading));
  SenseGround(observation);
  body_.fast = body_.vx - p_[kSpeed] - p_[kRiseSpeed] * body_.Rise();
  PlaceFeet();
  body_.touching_left = observation[kFootForce] + observation[kFootForce + 1] > kTouch;
  const auto socket = observation.subspan<kSocketForce, 3>();
  body_.touching_right = -socket[1] > kSocketTouch;
}

void Walker::Sense(std::span<const double, kWholeObservation> observation, double heading) {
  for (int j = 0; j < kLengthJoints; ++j) {
    state_.angles[j] = observation[whole::kAngles + whole::kJointPlaces[j]];
    velocity_[j] = observation[whole::kVelocities + whole::kJointPlaces[j]] / kWholeControlStep;
  }
  const auto copy = [&](size_t from, std::array<double, kWholeMuscles>& to) {
    std::copy_n(observation.begin() + static_cast<ptrdiff_t>(from), to.size(), to.begin());
  };
  copy(whole::kActivations, state_.activation);
  copy(whole::kLengths, state_.length);
  copy(whole::kMuscleVelocities, state_.velocity);
  SenseTrunk(observation.subspan<whole::kPelvis, 4>(),
             {observation[whole::kPlaceVelocity], observation[whole::kPlaceVelocity + 1]}, heading);
  body_.fast = body_.vx - p_[kSpeed];
  PlaceFeet();
  const auto force = observation.subspan<whole::kFootForce, 4>();
  body_.touching_right = force[0] + force[1] > kTouch;
  body_.touching_left = force[2] + force[3] > kTouch;
}

// `velocity`: in the world, of which only x and y count. `wanted`: the heading.
void Walker::SenseTrunk(std::span<const double, 4> q, const Vector& velocity, double wanted) {
  // The pelvis' frame lies a quarter turn about x ahead of the trunk's.
  const double half = std::sqrt(0.5);
  const Quaternion trunk = Quaternion{q[0], q[1], q[2], q[3]} * Quaternion{half, -half, 0, 0};
  const Quaternion turn = first_ ? Quaternion{} : last_.Conjugate() * trunk;
  const double rate = std::copysign(2.0, turn.w) / ControlStep();  // rad/s
  last_ = trunk;

  const Vector forwards = trunk.Turn({1, 0, 0});
  yaw_ = std::atan2(forwards[1], forwards[0]);
  tilt_ = About(2, -yaw_) * trunk;
  const Vector up = tilt_.Turn({0, 0, 1});
  body_.pitch = std::atan2(up[0], up[2]);
  body_.roll = std::atan2(-up[1], up[2]);
  const Vector spin = tilt_.Turn({rate * turn.x, rate * turn.y, rate * turn.z});
  body_.roll_rate = spin[0];
  body_.pitch_rate = spin[1];
  body_.yaw_rate = spin[2];
  body_.yaw = Wrapped(yaw_ - wanted);
  body_.vx = std::cos(yaw_) * velocity[0] + std::sin(yaw_) * velocity[1];
  body_.vy = -std::sin(yaw_) * velocity[0] + std::cos(yaw_) * velocity[1];
}

// The highest ground where each foot would land, as a foot must not stub.
void Walker::SenseGround(std::span<const double, kWalkerObservation> observation) {
  if (observed_ == Observed::kOfficial) {
    const double rise =
        observation[kHeights + kOfficialFoothold] - observation[kHeights + kOfficialUnder];
    body_.rise_left = body_.rise_right = std::clamp(rise, -kLargestRise, kLargestRise);
    return;
  }
  for (const bool right : {false, true}) {
    double rise = -kLargestRise;
    for (const size_t row : kFootholds) {
      const size_t cell = kMapSize * row + (right ? kNearestRight : kNearestLeft);
      rise = std::max(rise, observation[kHeights + cell]);
    }
    (right ? body_.rise_right : body_.rise_left) = std::min(rise, kLargestRise);
  }
}

void Walker::PlaceFeet() {
  const double half = std::sqrt(0.5);
  const Quaternion pelvis = tilt_ * Quaternion{half, half, 0, 0};
  const Vector middle = pelvis.Turn(kMiddle);
  for (const bool right : {false, true}) {
    const int hip = right ? kHipRight : kHipLeft;
    const double side = Sign(right);
    const Quaternion thigh = About(2, state_.angles[hip]) *
                             About(0, side * state_.angles[hip + 1]) *
                             About(1, side * state_.angles[hip + 2]);
    const double knee = right && legs_ == Legs::kProsthetic
                            ? kLegKneeGuess
                            : state_.angles[right ? kKneeRight : kKneeLeft];
    const Quaternion shank = thigh * About(2, -knee);
    const Vector in_pelvis = Vector{kHipPlace[0], kHipPlace[1], side * kHipPlace[2]} +
                             thigh.Turn({0, -kThigh, 0}) + shank.Turn({0, -kShank, 0});
    const Vector foot = pelvis.Turn(in_pelvis);
    (right ? body_.x_right : body_.x_left) = middle[0] - foot[0];
    (right ? body_.y_right : body_.y_left) = middle[1] - foot[1];
  }
}

// Which leg swings first: the one that is behind. A body that stands still leans forwards before.
void Walker::Begin() {
  swing_ = body_.x_left > body_.x_right + kApart ? Side::kLeft : Side::kRight;
  starting_ = std::abs(body_.x_left - body_.x_right) < kApart;
  swing_from_ = state_.angles[swing_ == Side::kRight ? kHipRight : kHipLeft] - body_.pitch;
  since_ = legs_ == Legs::kWhole && !starting_ ? begun_ : 0;
  early_ = 0;
}

// Ends a phase when the swinging foot has landed, or should have long ago.
void Walker::Advance() {
  since_ += ControlStep();
  if (starting_ || BothStand()) {
    swing_from_ = state_.angles[swing_ == Side::kRight ? kHipRight : kHipLeft] - body_.pitch;
  }
  if (starting_) {
    if (body_.x_left < p_[kStartPlace] && since_ < kLongestStart) return;
    starting_ = false;
    since_ = p_[kDoubleTime];
  }
  const bool left = swing_ == Side::kLeft;
  const double time = p_[kDoubleTime] + (left ? p_[kSwingTimeLeft] - p_[kSwingEarly] * early_
                                              : p_[kSwingTimeRight]);
  const bool touching = left ? body_.touching_left : body_.touching_right;
  if ((touching && since_ > 0.6 * time) || since_ > 2 * time) {
    early_ = left ? 0 : std::max(time - since_, 0.0);
    swing_ = left ? Side::kRight : Side::kLeft;
    swing_from_ = state_.angles[left ? kHipRight : kHipLeft] - body_.pitch;
    since_ = 0;
  }
}

void Walker::Pull(TorqueGoal& goal, int joint, double target, double stiffness, double damping,
                  double weight) const {
  goal.torque[joint] += stiffness * (target - state_.angles[joint]) - damping * velocity_[joint];
  goal.weight[joint] = weight;
}

// The standing hip keeps the trunk upright, carries the other side and turns to the heading. In the
// air it could only throw its own leg about, and waits for the ground with the leg where it is.
void Walker::ControlTrunk(Side stance, double part, TorqueGoal& goal) const {
  const bool right = stance == Side::kRight;
  const int hip = right ? kHipRight : kHipLeft;
  goal.weight[hip] = 1;
  goal.weight[hip + 1] = p_[kSideWeight];
  if (!(right ? body_.touching_right : body_.touching_left)) {
    goal.torque[hip] = -p_[kSwingDamping] * velocity_[hip];
    Pull(goal, hip + 1, 0, p_[kSideStiffness], p_[kSideDamping], p_[kSideWeight]);
    Turn(goal, hip, 0, 0);
    return;
  }
  const double pitch =
      starting_ ? p_[kStartPitch] : p_[kPitch] + p_[kRisePitch] * body_.Rise();
  const double lean =
      p_[kPitchStiffness] * (body_.pitch - pitch) + p_[kPitchDamping] * body_.pitch_rate;
  const int other = right ? kHipLeft : kHipRight;
  const double reaction = starting_ || BothStand() ? 0 : p_[kSwingReaction] * goal.torque[other];
  goal.torque[hip] = -part * lean - reaction;
  if (!starting_) {
    goal.torque[hip] -=
        p_[right ? kHipPushRight : kHipPushLeft] + p_[kHipSpeed] * body_.fast;
  }
  goal.torque[hip] = std::clamp(goal.torque[hip], -p_[kHipLimit], p_[kHipLimit]);
  const double roll = body_.roll - p_[right ? kRollRight : kRollLeft];
  goal.torque[hip + 1] =
      part * (Sign(right) * (p_[kRollStiffness] * roll + p_[kRollDamping] * body_.roll_rate) -
              p_[right ? kHipLiftRight : kHipLiftLeft]);
  if (starting_) Pull(goal, hip + 1, 0, p_[kStartSide], p_[kStartSideDamping], p_[kSideWeight]);
  Turn(goal, hip, starting_ ? 0 : p_[kTurnStance], p_[kTurnBias]);
  if (starting_ || BothStand()) return;
  // The swinging leg turns the body about the standing one.
  goal.torque[hip + 2] +=
      p_[right ? kTurnReactionRight : kTurnReactionLeft] * goal.torque[other] +
      Sign(right) * p_[right ? kYawDampingRight : kYawDampingLeft] * body_.yaw_rate;
}

// Turns the thigh of `hip` by `part` of what the body is beside its heading, and by `bias`.
void Walker::Turn(TorqueGoal& goal, int hip, double part, double bias) const {
  const double turn = std::clamp(part * body_.yaw - bias, -p_[kTurnLimit], p_[kTurnLimit]);
  Pull(goal, hip + 2, Sign(hip == kHipRight) * turn, p_[kTurnStiffness], p_[kTurnDamping],
       p_[kTurnWeight]);
}

// The swinging thigh goes to where the foot has to land, seen from the world and not the trunk.
void Walker::ControlSwingHip(Side swing, TorqueGoal& goal) const {
  const bool right = swing == Side::kRight;
  const int hip = right ? kHipRight : kHipLeft;
  const double outwards = right ? -1.0 : 1.0;  // of y
  const double x = right ? body_.x_left : body_.x_right;
  const double y = outwards * (right ? body_.y_left : body_.y_right);
  const double rise = right ? body_.rise_right : body_.rise_left;
  const double forwards =
      std::clamp(p_[right ? kSwingHipRight : kSwingHipLeft] +
                     p_[right ? kSwingPlaceRight : kSwingPlaceLeft] * x +
                     p_[right ? kSwingSpeedRight : kSwingSpeedLeft] * body_.fast +
                     p_[right ? kRiseHipRight : kRiseHipLeft] * rise,
                 -kFarthestBack, kFarthestAhead);
  const double aside =
      std::clamp(p_[right ? kSideHipRight : kSideHipLeft] +
                     p_[right ? kSidePlaceRight : kSidePlaceLeft] * y +
                     p_[right ? kSideSpeedRight : kSideSpeedLeft] * outwards * body_.vy,
                 -kFarthestAcross, kFarthestAside);
  // From where the thigh was, as smoothly as can be: a kick would turn the body about.
  const double time = p_[kSwingPart] * p_[right ? kSwingTimeRight : kSwingTimeLeft];
  const double passed = std::clamp((since_ + Lead() - p_[kDoubleTime]) / time, 0.0, 1.0);
  const double part = passed * passed * passed * (10 - passed * (15 - 6 * passed));
  const double target = swing_from_ + part * (forwards - swing_from_);
  Pull(goal, hip, target + body_.pitch, p_[kSwingStiffness], p_[kSwingDamping], 1);
  const double speed = 30 * passed * passed * (1 - passed) * (1 - passed) / time;  // per rad
  goal.torque[hip] += p_[kSwingDamping] * speed * (forwards - swing_from_);
  Pull(goal, hip + 1, -aside - Sign(right) * body_.roll, p_[kSideStiffness], p_[kSideDamping],
       p_[kSideWeight]);
  Turn(goal, hip, -p_[kTurnSwing], 0);
}

void Walker::ControlSoundLeg(Side side, TorqueGoal& goal) const {
  const bool right = side == Side::kRight;
  const int knee = right ? kKneeRight : kKneeLeft;
  const int ankle = knee + 1, subtalar = knee + 2, toes = knee + 3;
  const bool swinging = swing_ == side && !BothStand();
  Pull(goal, toes, 0, 8, 0.3, 0.2);
  if (!swinging || since_ < p_[kDoubleTime] + p_[kPushTime]) {
    const bool push = swinging || (right ? body_.x_right : body_.x_left) > p_[kPushPlace];
    if (swinging) {  // the other foot has landed: the knee gives way
      Pull(goal, knee, p_[kKneeSwing] / 2, p_[kKneeSwingStiffness], p_[kKneeSwingDamping], 1);
    } else {
      Pull(goal, knee, p_[kKneeStance], p_[kKneeStanceStiffness], p_[kKneeStanceDamping], 1);
    }
    const WalkerParameter target = starting_ ? kStartAnkle : push ? kAnklePush : kAnkleStance;
    Pull(goal, ankle, p_[target], p_[push ? kAnklePushStiffness : kAnkleStanceStiffness],
         p_[kAnkleStanceDamping], 1);
    if (!push && !starting_) goal.torque[ankle] -= p_[kAnkleLean] * body_.fast;
    Pull(goal, subtalar, 0, p_[kSubtalarStiffness], p_[kSubtalarDamping], 1);
    goal.torque[subtalar] -= Sign(right) * p_[kSubtalarSide] * body_.vy;
    return;
  }
  const bool flexing = since_ < p_[kDoubleTime] + p_[kKneeFlexTime] * p_[kSwingTimeLeft];
  const double rise = right ? body_.rise_right : body_.rise_left;
  const double bent = p_[kKneeSwing] + p_[kRiseKnee] * rise;
  Pull(goal, knee, flexing ? bent : p_[kKneeLanding],
       p_[flexing ? kKneeSwingStiffness : kKneeLandingStiffness],
       p_[flexing ? kKneeSwingDamping : kKneeLandingDamping], 1);
  Pull(goal, ankle, p_[kAnkleSwing], p_[kAnkleSwingStiffness], p_[kAnkleSwingStiffness] / 20, 1);
  Pull(goal, subtalar, 0, 15, 1, 1);
}

// s by which a swing is ahead of its time: the prosthesis' if the sound foot has landed too near to
// the body, which falls onto a bent knee unless the swing is earlier, too; the sound leg's if the
// prosthesis has landed early.
double Walker::Lead() const {
  if (starting_ || legs_ == Legs::kWhole) return 0;
  if (swing_ == Side::kLeft) return p_[kSwingEarly] * early_;
  const double fallback = kMeanPlace + kMeanSpeed * std::max(since_ - p_[kDoubleTime], 0.0);
  return p_[kSwingLead] * std::clamp((body_.x_left - fallback) / kLeadSpeed, 0.0, kLongestLead);
}

int Walker::LegMode() const {
  if (starting_) return 3;
  if (swing_ == Side::kLeft || BothStand()) return body_.x_right > p_[kLegPushPlace] ? 1 : 0;
  const double bent =
      (p_[kLegFlexTime] + p_[kRiseFlex] * body_.rise_right) * p_[kSwingTimeRight];
  return since_ - p_[kDoubleTime] + Lead() < bent ? 2 : 3;
}

void Walker::Act(std::span<const double, kWalkerObservation> observation,
                 std::span<double, kWalkerAction> action) {
  Sense(observation);
  muscles_.Allocate(state_, Plan(), action.first<kMuscles>());
  action[kMuscles] = LegMode();
}

void Walker::Act(std::span<const double, kWholeObservation> observation, double heading,
                 std::span<double, kWholeMuscles> action) {
  Sense(observation, heading);
  muscles_.Allocate(state_, Plan(), action);
}

// The torques for what has been sensed.
TorqueGoal Walker::Plan() {
  if (first_) {
    Begin();
    first_ = false;
  } else {
    Advance();
  }
  TorqueGoal goal;
  const Side stance = swing_ == Side::kLeft ? Side::kRight : Side::kLeft;
  if (starting_ || BothStand()) {
    const double part = body_.touching_left && body_.touching_right ? 0.5 : 1;
    ControlTrunk(Side::kLeft, part, goal);
    ControlTrunk(Side::kRight, part, goal);
  } else {
    ControlSwingHip(swing_, goal);
    ControlTrunk(stance, 1, goal);
  }
  for (const Side side : {Side::kLeft, Side::kRight}) {
    if (Sound(side)) ControlSoundLeg(side, goal);
  }
  return goal;
}

}  // namespace myograde::baseline
