#include <array>

#include "protocol/tracks/height_cells.h"
#include "protocol/tracks/locomotion/track.h"

namespace myograde {
namespace locomotion {
namespace {

using Entry = LayoutEntry;

// The observed joints of both legs with their ranges (rad; m for translations), in observation
// order.
constexpr Entry kJoints[] = {
    {"hip_adduction_l", {-0.872665, 0.523599}}, {"hip_flexion_l", {-0.523599, 2.0944}},
    {"hip_rotation_l", {-0.698132, 0.698132}}, {"hip_adduction_r", {-0.872665, 0.523599}},
    {"hip_flexion_r", {-0.523599, 2.0944}}, {"hip_rotation_r", {-0.698132, 0.698132}},
    {"knee_angle_l", {0, 2.0944}}, {"knee_angle_l_beta_rotation1", {-1.79241, 0.010506}},
    {"knee_angle_l_beta_translation1", {-0.0227731, 0.0524192}}, {"knee_angle_l_beta_translation2",
    {-0.0408267, -0.0108281}}, {"knee_angle_l_rotation2", {-0.00167821, 0.0335354}},
    {"knee_angle_l_rotation3", {-0.262788, -1.08939e-08}}, {"knee_angle_l_translation1",
    {9.53733e-08, 0.00159883}}, {"knee_angle_l_translation2", {-0.006792, -7.69254e-11}},
    {"mtp_angle_l", {-0.523599, 0.523599}}, {"ankle_angle_l", {-0.698132, 0.523599}},
    {"subtalar_angle_l", {-0.349066, 0.349066}},
};

// Muscles in the order of the official model's actuators: activations and actions.
constexpr std::string_view kMuscles[] = {
    "addbrev_r", "addlong_r", "glmax1_r", "glmax2_r", "glmax3_r", "glmed1_r", "glmed2_r",
    "glmed3_r", "glmin1_r", "glmin2_r", "glmin3_r", "iliacus_r", "piri_r", "psoas_r", "addbrev_l",
    "addlong_l", "addmagDist_l", "addmagIsch_l", "addmagMid_l", "addmagProx_l", "bflh_l", "bfsh_l",
    "edl_l", "ehl_l", "fdl_l", "fhl_l", "gaslat_l", "gasmed_l", "glmax1_l", "glmax2_l", "glmax3_l",
    "glmed1_l", "glmed2_l", "glmed3_l", "glmin1_l", "glmin2_l", "glmin3_l", "grac_l", "iliacus_l",
    "perbrev_l", "perlong_l", "piri_l", "psoas_l", "recfem_l", "sart_l", "semimem_l", "semiten_l",
    "soleus_l", "tfl_l", "tibant_l", "tibpost_l", "vasint_l", "vaslat_l", "vasmed_l",
};

// The same muscles in the order in which the official environment lists their lengths, velocities
// and forces: by name, the left side of a pair first.
constexpr std::string_view kMusclesByName[] = {
    "addbrev_l", "addbrev_r", "addlong_l", "addlong_r", "addmagDist_l", "addmagIsch_l",
    "addmagMid_l", "addmagProx_l", "bflh_l", "bfsh_l", "edl_l", "ehl_l", "fdl_l", "fhl_l",
    "gaslat_l", "gasmed_l", "glmax1_l", "glmax1_r", "glmax2_l", "glmax2_r", "glmax3_l", "glmax3_r",
    "glmed1_l", "glmed1_r", "glmed2_l", "glmed2_r", "glmed3_l", "glmed3_r", "glmin1_l", "glmin1_r",
    "glmin2_l", "glmin2_r", "glmin3_l", "glmin3_r", "grac_l", "iliacus_l", "iliacus_r", "perbrev_l",
    "perlong_l", "piri_l", "piri_r", "psoas_l", "psoas_r", "recfem_l", "sart_l", "semimem_l",
    "semiten_l", "soleus_l", "tfl_l", "tibant_l", "tibpost_l", "vasint_l", "vaslat_l", "vasmed_l",
};

constexpr Bounds kClipped{-100, 100};    // muscle velocities and forces are clipped to these
constexpr Bounds kForce{-1e5, 1e5};      // N

std::vector<Entry> JointVelocities() {
  std::vector<Entry> entries(std::begin(kJoints), std::end(kJoints));
  for (Entry& entry : entries) entry.bounds = kSpeed;
  return entries;
}

void AddBody(VectorLayout& v) {
  v.Add("internal_qpos", "rad, m", "Joint angles of both legs (m where the name says translation).",
        {std::begin(kJoints), std::end(kJoints)});
  v.Add("internal_qvel", "rad/s, m/s",
        "Velocities of the same joints; in the profile myosuite multiplied by the control period "
        "of 0.005 s.",
        JointVelocities());
  v.Add("grf", "N", "Touch sensors of the left, sound foot.",
        {{"l_foot", {0, 1e5}}, {"l_toes", {0, 1e5}}});
  v.Add("socket_force", "N", "Force in the socket, in the frame of its sensor on the pylon.",
        {{"x", kForce}, {"y", kForce}, {"z", kForce}});
  v.Add("torso_angle", "1", "Orientation of the pelvis in the world as a quaternion w, x, y, z.",
        {{"qw", {-1, 1}}, {"qx", {-1, 1}}, {"qy", {-1, 1}}, {"qz", {-1, 1}}});
}

void AddMuscles(VectorLayout& v) {
  v.Add("act", "1", "Activations of the muscles, in the order of the action.",
        LayoutEntries(kMuscles, {0, 1}));
  v.Add("muscle_length", "m", "Lengths of the muscles with their tendons, ordered by name.",
        LayoutEntries(kMusclesByName, {0, 2}));
  v.Add("muscle_velocity", "m/s", "Rates of the lengths, clipped to +-100, ordered by name.",
        LayoutEntries(kMusclesByName, kClipped));
  v.Add("muscle_force", "kN", "Forces, negative when pulling, clipped to +-100, ordered by name.",
        LayoutEntries(kMusclesByName, kClipped));
}

VectorLayout Observation() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 300.01}}});
  v.Add("terrain", "1", "Kind of course: 0 flat, 1 hilly, 2 rough, 3 stairs, 4 mixed.",
        {{"", {0, 4}}});
  AddBody(v);
  AddMuscles(v);
  v.Add("model_root_pos", "m", "Position of the pelvis in the world; people walk towards -y.",
        {{"x", {-3, 3}}, {"y", {-60, 60}}});
  v.Add("model_root_vel", "m/s", "Its velocity in the world's axes.",
        {{"x", kSpeed}, {"y", kSpeed}});
  v.Add("hfield", "m",
        "Heights of the ground on a grid around the pelvis in the heading's frame, row by row, the "
        "first row farthest ahead, the first column leftmost. Profile paper: cells of 0.2 m, "
        "relative to the ground under the pelvis; myosuite: 0.5 m apart, raw heights of the field.",
        HeightCells({-5, 5}));
  return v;
}

VectorLayout Action() {
  VectorLayout v;
  v.Add("muscles", "1",
        "Excitation of each muscle. Normalized: a in [-1, 1] excites by 1/(1 + exp(-5(a - 0.5))); "
        "direct: the excitation itself, in [0, 1].",
        LayoutEntries(kMuscles, {-1, 1}));
  v.Add("leg_set", "1", "Number of the prosthetic leg's parameter set, 0 to 4, rounded.",
        {{"", {0, 4}}});
  return v;
}

TrackLayout Layout() {
  TrackLayout layout{.observation = Observation(),
                     .extra = {},
                     .action = Action(),
                     .direct_bounds = {}};
  layout.direct_bounds.assign(std::size(kMuscles), Bounds{0, 1});
  layout.direct_bounds.push_back({0, 4});
  return layout;
}

}  // namespace
}  // namespace locomotion

const TrackLayout& LocomotionLayout() {
  static const TrackLayout layout = locomotion::Layout();
  return layout;
}

}  // namespace myograde
