// The arm with its hand that several models share: joints and muscles in the order of the models'
// positions and of the official actuators.
#pragma once

#include "protocol/tracks/hand.h"

namespace myograde {

// With their ranges in rad.
inline constexpr LayoutEntry kUpperArmJoints[] = {
    {"sternoclavicular_r2", {-0.75, 0}},   {"sternoclavicular_r3", {0, 0.318}},
    {"unrotscap_r3", {-0.318, 0}},         {"unrotscap_r2", {0, 0.75}},
    {"acromioclavicular_r2", {-0.152, 0}}, {"acromioclavicular_r3", {0, 1.228}},
    {"acromioclavicular_r1", {0, 0.552}},  {"unrothum_r1", {-0.552, 0}},
    {"unrothum_r3", {-1.228, 0}},          {"unrothum_r2", {0, 0.152}},
    {"elv_angle", {-1.658, 2.269}},        {"shoulder_elv", {0, 3.142}},
    {"shoulder1_r2", {-2.242, 1.658}},     {"shoulder_rot", {-1.571, 2.094}},
    {"elbow_flexion", {0, 2.269}},
};

inline constexpr std::string_view kUpperArmMuscles[] = {
    "DELT1",  "DELT2",  "DELT3", "SUPSP", "INFSP",   "SUBSC",    "TMIN", "TMAJ",
    "PECM1",  "PECM2",  "PECM3", "LAT1",  "LAT2",    "LAT3",     "CORB", "TRIlong",
    "TRIlat", "TRImed", "ANC",   "SUP",   "BIClong", "BICshort", "BRA",  "BRD",
};

inline constexpr auto kArmJoints = Joined(kUpperArmJoints, kHandJoints);
inline constexpr auto kArmJointNames = NamesOf(kArmJoints);
inline constexpr auto kArmMuscles = Joined(kUpperArmMuscles, kHandMuscles);

}  // namespace myograde
