#include <array>
#include <numbers>

#include "protocol/tracks/arm.h"
#include "protocol/tracks/manipulation/track.h"

namespace myograde {
namespace manipulation {
namespace {

using Entry = LayoutEntry;

// With their ranges in rad.
constexpr Entry kProsthesisJoints[] = {
    {"Lshoulder_fe", {-0.611, 2.792}}, {"Lshoulder_abad", {-2.792, 0}}, {"Lhumeral_rot", {-0.524,
    1.483}}, {"Lelbow", {0.05, 2.356}}, {"wrist_PRO", {-1.57, 1.57}}, {"wrist_UDEV", {-0.261,
    0.785}}, {"wrist_FLEX", {-1.04, 1.04}}, {"thumb_ABD", {0, 2.07}}, {"thumb_MCP", {0, 1.03}},
    {"thumb_PIP", {0, 1.03}}, {"thumb_DIP", {-0.819, 1.28}}, {"index_ABD", {0, 0.345}},
    {"index_MCP", {-0.785, 1.57}}, {"index_PIP", {0, 1.72}}, {"index_DIP", {0, 1.38}},
    {"middle_MCP", {-0.785, 1.57}}, {"middle_PIP", {0, 1.73}}, {"middle_DIP", {0, 1.38}},
    {"ring_ABD", {0, 0.345}}, {"ring_MCP", {-0.785, 1.57}}, {"ring_PIP", {0, 1.72}}, {"ring_DIP",
    {0, 1.38}}, {"pinky_ABD", {0, 0.345}}, {"pinky_MCP", {-0.785, 1.57}}, {"pinky_PIP", {0, 1.72}},
    {"pinky_DIP", {0, 1.38}},
};

// The prosthesis' position servos with the ranges of their targets (rad), which differ slightly
// from the ranges of the joints that they drive.
constexpr Entry kServos[] = {
    {"Lshoulder_fe", {-0.611, 2.792}}, {"Lshoulder_abad", {-2.792, 0}}, {"Lhumeral_rot", {-0.524,
    1.483}}, {"Lelbow", {0.05, 2.356}}, {"A_wrist_PRO", {-1.57, 1.57}}, {"A_wrist_UDEV", {-0.26,
    0.79}}, {"A_wrist_FLEX", {-1, 1}}, {"A_thumb_ABD", {0, 2.1}}, {"A_thumb_MCP", {0, 1.0}},
    {"A_thumb_PIP", {0, 1.0}}, {"A_thumb_DIP", {-0.82, 1.3}}, {"A_index_ABD", {0, 0.34}},
    {"A_index_MCP", {0, 1.6}}, {"A_middle_MCP", {0, 1.6}}, {"A_ring_MCP", {0, 1.6}}, {"A_pinky_ABD",
    {0, 0.34}}, {"A_pinky_MCP", {0, 1.6}},
};

constexpr std::string_view kTouching[] = {"arm", "prosthesis", "start_pillar", "goal_pillar",
                                          "anything_else"};
constexpr Bounds kPlace{-3, 3};      // m: everything happens well inside

VectorLayout Observation() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 10.01}}});
  v.Add("myohand_qpos", "rad", "Joint angles of the muscle arm and hand.", AllOf(kArmJoints));
  v.Add("myohand_qvel", "rad/s", "Velocities of the same joints.", EntriesWith(kArmJoints, kSpeed));
  v.Add("pros_hand_qpos", "rad", "Joint angles of the prosthetic arm and hand.",
        AllOf(kProsthesisJoints));
  v.Add("pros_hand_qvel", "rad/s", "Velocities of the same joints.",
        EntriesWith(kProsthesisJoints, kSpeed));
  v.Add("object_qpos", "m, 1",
        "Position of the object's frame in the world, then its orientation as a quaternion w, x, "
        "y, z.",
        {{"x", kPlace},
         {"y", kPlace},
         {"z", kPlace},
         {"qw", {-1, 1}},
         {"qx", {-1, 1}},
         {"qy", {-1, 1}},
         {"qz", {-1, 1}}});
  v.Add("object_qvel", "m/s, rad/s",
        "Linear velocity of the object in the world's frame, then angular velocity in its own.",
        {{"vx", kSpeed},
         {"vy", kSpeed},
         {"vz", kSpeed},
         {"wx", kSpeed},
         {"wy", kSpeed},
         {"wz", kSpeed}});
  v.Add("start_pos", "m", "Centre of the start pillar's body in the world, 0.04 m below its face.",
        LayoutEntries(kAxes, kPlace));
  v.Add("goal_pos", "m", "Centre of the goal pillar's body in the world, 0.04 m below its face.",
        LayoutEntries(kAxes, kPlace));
  v.Add("touching_body", "1",
        "1 where the object touches it, else 0; floor and stage are anything else (in the profiles "
        "that follow the official code they count as the arm).",
        LayoutEntries(kTouching, {0, 1}));
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kArmMuscles, {0, 1}));
  v.Add("reach_err", "m", "From the object's touch site to the arm's palm, in the world's axes.",
        LayoutEntries(kAxes, kPlace));
  v.Add("pass_err", "m",
        "From the object's touch site to the prosthesis' palm, in the world's axes.",
        LayoutEntries(kAxes, kPlace));
  return v;
}

// What the official dictionary has beyond that, except copies of it (qp, qv, elbow_fle).
VectorLayout Extra() {
  const std::vector<Entry> place = LayoutEntries(kAxes, kPlace);
  const std::vector<Entry> angles = LayoutEntries(kAngles, {-std::numbers::pi, std::numbers::pi});
  VectorLayout v;
  v.Add("max_force", "N", "Largest reading of the object's touch sensor at a frame so far.",
        {{"", {0, 1e5}}});
  v.Add("palm_pos", "m", "The arm's palm in the world.", place);
  constexpr std::string_view kTips[][2] = {{"fin0", "The tip of the thumb in the world."},
                                           {"fin1", "The tip of the index finger."},
                                           {"fin2", "The tip of the middle finger."},
                                           {"fin3", "The tip of the ring finger."},
                                           {"fin4", "The tip of the little finger."}};
  for (const auto& [name, meaning] : kTips) v.Add(name, "m", meaning, place);
  v.Add("Rpalm_pos", "m", "The prosthesis' palm in the world: the middle of its two sites.", place);
  v.Add("MPL_ori", "rad", "Orientation of the prosthesis' palm in the world, as Euler angles.",
        angles);
  v.Add("MPL_ori_err", "rad", "MPL_ori minus (pi, 0, pi), not wrapped.",
        LayoutEntries(kAngles, {-2 * std::numbers::pi, std::numbers::pi}));
  v.Add("obj_pos", "m", "The object's touch site in the world.", place);
  return v;
}

VectorLayout Action() {
  VectorLayout v = MuscleActions(kArmMuscles);
  v.Add("prosthesis", "1 or rad",
        "Target angle of each servo. Normalized: -1 to 1 from the lowest to the highest target; "
        "direct: the target itself, in rad.",
        EntriesWith(kServos, {-1, 1}));
  return v;
}

TrackLayout Layout() {
  TrackLayout layout{.observation = Observation(),
                     .extra = Extra(),
                     .action = Action(),
                     .direct_bounds = {}};
  layout.direct_bounds.assign(std::size(kArmMuscles), Bounds{0, 1});
  for (const Entry& servo : kServos) layout.direct_bounds.push_back(servo.bounds);
  return layout;
}

}  // namespace
}  // namespace manipulation

const TrackLayout& ManipulationLayout() {
  static const TrackLayout layout = manipulation::Layout();
  return layout;
}

}  // namespace myograde
