// The numbers of the walker that a search may change, by name.
#pragma once

#include <array>
#include <cstddef>

namespace myograde::baseline {

struct ParameterInfo {
  const char* name;
  double start;      // what a search starts from
  double deviation;  // the search's first standard deviation
  double low, high;
};

// In the order of kWalkerParameters. Angles in rad, times in s, gains in N m/rad and N m s/rad.
// "Left" is the sound leg, "Right" the prosthetic one. Forwards, outwards and flexion are positive.
enum WalkerParameter : size_t {
  kSpeed,            // m/s, wanted
  kEffort,           // (N m)^2 that a squared activation costs
  kPitch, kPitchStiffness, kPitchDamping,
  kRollLeft, kRollRight, kRollStiffness, kRollDamping,
  kTurnStiffness, kTurnDamping,           // of the hips' rotation
  kTurnStance, kTurnSwing, kTurnLimit,    // rad of it per rad beside the heading
  kSteering,                              // rad of heading per m beside the line
  kLine,                                  // m to the left of the middle, where it aims
  kHipLiftLeft, kHipLiftRight,            // N m of abduction that carry the swinging side
  kSwingStiffness, kSwingDamping,
  kSideStiffness, kSideDamping,
  kSwingTimeLeft, kSwingTimeRight,
  kSwingHipLeft, kSwingHipRight,          // rad of the thigh
  kSwingPlaceLeft, kSwingPlaceRight,      // rad per m of the body before the standing foot
  kSwingSpeedLeft, kSwingSpeedRight,      // rad per m/s
  kSideHipLeft, kSideHipRight,
  kSidePlaceLeft, kSidePlaceRight,
  kSideSpeedLeft, kSideSpeedRight,
  kKneeSwing, kKneeLanding, kKneeSwingStiffness, kKneeSwingDamping, kKneeFlexTime,
  kKneeStance, kKneeStanceStiffness, kKneeStanceDamping,
  kAnkleStance, kAnkleStanceStiffness, kAnkleStanceDamping, kAnkleLean,
  kAnklePush, kAnklePushStiffness, kPushPlace, kPushTime,
  kAnkleSwing, kAnkleSwingStiffness,
  kSubtalarStiffness, kSubtalarDamping, kSubtalarSide,
  kLegKneeStance, kLegKneeStanceStiffness, kLegKneeStanceDamping,
  kLegAnkleStance, kLegAnkleStanceStiffness, kLegAnkleStanceDamping,
  kLegPush, kLegPushStiffness, kLegPushPlace,
  kLegKneeSwing, kLegKneeSwingStiffness, kLegKneeSwingDamping, kLegFlexTime, kLegAnkleSwing,
  kLegKneeLanding, kLegKneeLandingStiffness, kLegKneeLandingDamping,
  kHipPushLeft, kHipPushRight,            // N m of extension in stance
  kSwingReaction,                         // part of the swinging hip's torque that the other takes
  kHipSpeed,                              // N m of extension per m/s above the wanted speed
  kStartPitch, kStartPlace, kStartAnkle,
  kKneeLandingStiffness, kKneeLandingDamping, kLegAnkleSwingStiffness,
  kDoubleTime,                            // s with both feet on the ground
  kTurnBias,                              // rad of the standing hip's rotation, to the left
  kDrift, kCrab,                          // m/s sideways per m beside the line, and per m/s
  kStartSide, kStartSideDamping,
  kHipLimit,                              // N m of flexion and extension at the standing hip
  kSideWeight, kTurnWeight,               // of missed torque, against flexion's 1
  kSwingPart,                             // of the swing's time, in which the thigh gets there
  kSwingLead,                             // of the time that the body is early over the sound foot,
                                          // by which the prosthesis' swing goes on
  kSwingEarly,                            // of the time that the prosthesis has landed early, by
                                          // which the sound leg's swing goes on
  kRiseHipLeft, kRiseHipRight,            // rad of the swinging thigh per m that the ground rises
  kRiseKnee,                              // rad of the sound knee's swing per m
  kRiseFlex,                              // of the prosthesis' swing, for which its knee bends, per m
  kRisePitch, kRiseSpeed,                 // rad of the trunk, and m/s that are wanted, per m
  kTurnReactionLeft, kTurnReactionRight,  // part of the swinging hip's torque that the standing one
                                          // turns against
  kYawDampingLeft, kYawDampingRight,
  kWalkerParameterCount
};

inline constexpr std::array<ParameterInfo, kWalkerParameterCount> kWalkerParameters = {{
    {"speed", 1.0, 0.15, 0.2, 2.0},
    {"effort", 20, 5, 1, 200},
    {"pitch", 0.05, 0.05, -0.3, 0.4},
    {"pitch_stiffness", 500, 100, 0, 2000},
    {"pitch_damping", 50, 12, 0, 300},
    {"roll_left", 0, 0.03, -0.3, 0.3},
    {"roll_right", 0, 0.03, -0.3, 0.3},
    {"roll_stiffness", 500, 100, 0, 2000},
    {"roll_damping", 50, 12, 0, 300},
    {"turn_stiffness", 120, 30, 0, 600},
    {"turn_damping", 8, 3, 0, 60},
    {"turn_stance", 0.5, 0.2, -1, 3},
    {"turn_swing", 0.3, 0.2, -2, 2},
    {"turn_limit", 0.25, 0.06, 0.02, 0.6},
    {"steering", 0.3, 0.1, 0, 2},
    {"line", 0, 0.2, -1, 1},
    {"hip_lift_left", 50, 12, 0, 150},
    {"hip_lift_right", 50, 12, 0, 150},
    {"swing_stiffness", 150, 40, 10, 800},
    {"swing_damping", 15, 4, 0, 100},
    {"side_stiffness", 150, 40, 10, 800},
    {"side_damping", 15, 4, 0, 100},
    {"swing_time_left", 0.45, 0.05, 0.2, 0.9},
    {"swing_time_right", 0.45, 0.05, 0.2, 0.9},
    {"swing_hip_left", 0.35, 0.07, -0.2, 1.0},
    {"swing_hip_right", 0.35, 0.07, -0.2, 1.0},
    {"swing_place_left", 0.2, 0.15, -1, 3},
    {"swing_place_right", 0.2, 0.15, -1, 3},
    {"swing_speed_left", 0.25, 0.08, -0.5, 1.5},
    {"swing_speed_right", 0.25, 0.08, -0.5, 1.5},
    {"side_hip_left", 0.02, 0.03, -0.3, 0.4},
    {"side_hip_right", 0.02, 0.03, -0.3, 0.4},
    {"side_place_left", 0.4, 0.2, -2, 3},
    {"side_place_right", 0.4, 0.2, -2, 3},
    {"side_speed_left", 0.4, 0.1, -0.5, 2},
    {"side_speed_right", 0.4, 0.1, -0.5, 2},
    {"knee_swing", 1.0, 0.15, 0.2, 1.6},
    {"knee_landing", 0.1, 0.06, 0, 0.6},
    {"knee_swing_stiffness", 80, 20, 5, 400},
    {"knee_swing_damping", 6, 2, 0, 50},
    {"knee_flex_time", 0.4, 0.07, 0.1, 0.9},
    {"knee_stance", 0.12, 0.05, 0, 0.5},
    {"knee_stance_stiffness", 400, 80, 20, 2000},
    {"knee_stance_damping", 20, 5, 0, 100},
    {"ankle_stance", 0.0, 0.05, -0.4, 0.4},
    {"ankle_stance_stiffness", 250, 60, 0, 1500},
    {"ankle_stance_damping", 15, 4, 0, 100},
    {"ankle_lean", 0, 20, -300, 300},
    {"ankle_push", -0.3, 0.08, -0.6, 0.3},
    {"ankle_push_stiffness", 200, 60, 0, 1500},
    {"push_place", 0.12, 0.05, -0.2, 0.6},
    {"push_time", 0.08, 0.03, 0, 0.3},
    {"ankle_swing", 0.1, 0.05, -0.3, 0.4},
    {"ankle_swing_stiffness", 40, 12, 0, 300},
    {"subtalar_stiffness", 60, 30, 0, 400},
    {"subtalar_damping", 3, 1, 0, 40},
    {"subtalar_side", 0, 15, -300, 300},
    {"leg_knee_stance", 0.06, 0.03, 0, 0.5},
    {"leg_knee_stance_stiffness", 500, 120, 20, 2000},
    {"leg_knee_stance_damping", 10, 3, 0, 100},
    {"leg_ankle_stance", 0, 0.05, -0.4, 0.4},
    {"leg_ankle_stance_stiffness", 250, 60, 0, 1500},
    {"leg_ankle_stance_damping", 8, 3, 0, 100},
    {"leg_push", -0.3, 0.08, -0.52, 0.3},
    {"leg_push_stiffness", 200, 60, 0, 1500},
    {"leg_push_place", 0.12, 0.05, -0.2, 0.6},
    {"leg_knee_swing", 1.1, 0.15, 0.2, 1.8},
    {"leg_knee_swing_stiffness", 60, 15, 5, 400},
    {"leg_knee_swing_damping", 1.5, 0.6, 0, 30},
    {"leg_flex_time", 0.5, 0.07, 0.1, 0.9},
    {"leg_ankle_swing", 0.15, 0.06, -0.3, 0.5},
    {"leg_knee_landing", 0.06, 0.03, 0, 0.5},
    {"leg_knee_landing_stiffness", 100, 15, 5, 600},
    {"leg_knee_landing_damping", 4, 1.2, 0, 50},
    {"hip_push_left", 0, 10, -100, 150},
    {"hip_push_right", 0, 10, -100, 150},
    {"swing_reaction", 0.5, 0.15, -0.5, 1.5},
    {"hip_speed", 0, 10, -200, 200},
    {"start_pitch", 0.05, 0.06, -0.2, 0.6},
    {"start_place", 0.06, 0.03, 0, 0.3},
    {"start_ankle", 0.25, 0.06, -0.3, 0.5},
    {"knee_landing_stiffness", 150, 40, 5, 600},
    {"knee_landing_damping", 10, 3, 0, 60},
    {"leg_ankle_swing_stiffness", 120, 30, 5, 600},
    {"double_time", 0.005, 0.015, 0, 0.4},
    {"turn_bias", 0, 0.05, -0.4, 0.4},
    {"drift", 0.1, 0.1, -1, 2},
    {"crab", 0.1, 0.15, -1, 2},
    {"start_side", 500, 100, 0, 2000},
    {"start_side_damping", 50, 12, 0, 300},
    {"hip_limit", 400, 50, 10, 500},
    {"side_weight", 1, 0.3, 0.2, 30},
    {"turn_weight", 1, 0.4, 0.2, 60},
    {"swing_part", 0.3, 0.15, 0.01, 1.2},
    {"swing_lead", 0, 0.3, 0, 2},
    {"swing_early", 0, 0.2, -2, 3},
    {"rise_hip_left", 0, 0.7, -5, 5},
    {"rise_hip_right", 0, 0.7, -5, 5},
    {"rise_knee", 0, 1, -5, 5},
    {"rise_flex", 0, 1, -5, 5},
    {"rise_pitch", 0, 0.5, -3, 3},
    {"rise_speed", 0, 1, -8, 8},
    {"turn_reaction_left", 0, 0.1, -2, 2},
    {"turn_reaction_right", 0, 0.1, -2, 2},
    {"yaw_damping_left", 0, 2, -50, 50},
    {"yaw_damping_right", 0, 2, -50, 50},
}};

using WalkerNumbers = std::array<double, kWalkerParameterCount>;

// What every parameter starts from.
constexpr WalkerNumbers StartingNumbers() {
  WalkerNumbers numbers{};
  for (size_t i = 0; i < numbers.size(); ++i) numbers[i] = kWalkerParameters[i].start;
  return numbers;
}

}  // namespace myograde::baseline
