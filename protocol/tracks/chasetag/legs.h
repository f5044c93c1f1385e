// Both legs: joints and muscles in the order of the model's positions and of the official
// actuators.
#pragma once

#include "protocol/tracks/hand.h"

namespace myograde {

// With their ranges in rad, of translations in m.
inline constexpr std::array kLegsJoints = std::to_array<LayoutEntry>({
    {"hip_flexion_r", {-0.523599, 2.0944}}, {"hip_adduction_r", {-0.872665, 0.523599}},
    {"hip_rotation_r", {-0.698132, 0.698132}},
    {"knee_angle_r_translation2", {7.69254e-11, 0.006792}},
    {"knee_angle_r_translation1", {9.53733e-08, 0.00159883}}, {"knee_angle_r", {0, 2.0944}},
    {"knee_angle_r_rotation2", {-0.00167821, 0.0335354}},
    {"knee_angle_r_rotation3", {1.08939e-08, 0.262788}},
    {"ankle_angle_r", {-0.698132, 0.523599}}, {"subtalar_angle_r", {-0.349066, 0.349066}},
    {"mtp_angle_r", {-0.523599, 0.523599}},
    {"knee_angle_r_beta_translation2", {-0.0408267, -0.0108281}},
    {"knee_angle_r_beta_translation1", {-0.0227731, 0.0524192}},
    {"knee_angle_r_beta_rotation1", {-1.79241, 0.010506}},
    {"hip_flexion_l", {-0.523599, 2.0944}}, {"hip_adduction_l", {-0.872665, 0.523599}},
    {"hip_rotation_l", {-0.698132, 0.698132}},
    {"knee_angle_l_translation2", {-0.006792, -7.69254e-11}},
    {"knee_angle_l_translation1", {9.53733e-08, 0.00159883}}, {"knee_angle_l", {0, 2.0944}},
    {"knee_angle_l_rotation2", {-0.00167821, 0.0335354}},
    {"knee_angle_l_rotation3", {-0.262788, -1.08939e-08}},
    {"ankle_angle_l", {-0.698132, 0.523599}}, {"subtalar_angle_l", {-0.349066, 0.349066}},
    {"mtp_angle_l", {-0.523599, 0.523599}},
    {"knee_angle_l_beta_translation2", {-0.0408267, -0.0108281}},
    {"knee_angle_l_beta_translation1", {-0.0227731, 0.0524192}},
    {"knee_angle_l_beta_rotation1", {-1.79241, 0.010506}},
});
inline constexpr auto kLegsJointNames = NamesOf(kLegsJoints);

inline constexpr std::string_view kLegsMuscles[] = {
    "addbrev_r", "addlong_r", "addmagDist_r", "addmagIsch_r", "addmagMid_r", "addmagProx_r",
    "bflh_r", "bfsh_r", "edl_r", "ehl_r", "fdl_r", "fhl_r", "gaslat_r", "gasmed_r", "glmax1_r",
    "glmax2_r", "glmax3_r", "glmed1_r", "glmed2_r", "glmed3_r", "glmin1_r", "glmin2_r",
    "glmin3_r", "grac_r", "iliacus_r", "perbrev_r", "perlong_r", "piri_r", "psoas_r",
    "recfem_r", "sart_r", "semimem_r", "semiten_r", "soleus_r", "tfl_r", "tibant_r",
    "tibpost_r", "vasint_r", "vaslat_r", "vasmed_r", "addbrev_l", "addlong_l", "addmagDist_l",
    "addmagIsch_l", "addmagMid_l", "addmagProx_l", "bflh_l", "bfsh_l", "edl_l", "ehl_l",
    "fdl_l", "fhl_l", "gaslat_l", "gasmed_l", "glmax1_l", "glmax2_l", "glmax3_l", "glmed1_l",
    "glmed2_l", "glmed3_l", "glmin1_l", "glmin2_l", "glmin3_l", "grac_l", "iliacus_l",
    "perbrev_l", "perlong_l", "piri_l", "psoas_l", "recfem_l", "sart_l", "semimem_l",
    "semiten_l", "soleus_l", "tfl_l", "tibant_l", "tibpost_l", "vasint_l", "vaslat_l",
    "vasmed_l",
};

}  // namespace myograde
