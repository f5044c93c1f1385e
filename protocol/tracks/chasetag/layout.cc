#include "protocol/tracks/chasetag/legs.h"
#include "protocol/tracks/chasetag/track.h"
#include "protocol/tracks/height_cells.h"

namespace myograde {
namespace chasetag {
namespace {

constexpr Bounds kPlace{-10, 10};    // m: well beyond the field
constexpr Bounds kForce{0, 1e5};     // N
constexpr Bounds kClipped{-100, 100};

VectorLayout Observation() {
  VectorLayout v;
  v.Add("internal_qpos", "rad, m", "Joint angles of both legs (m where the name says translation).",
        AllOf(kLegsJoints));
  v.Add("internal_qvel", "rad/s, m/s",
        "Velocities of the same joints (in the profile that follows the official code times 0.01 "
        "s).",
        EntriesWith(kLegsJoints, kSpeed));
  v.Add("grf", "N", "Touch sensors of the feet.",
        {{"r_foot", kForce}, {"r_toes", kForce}, {"l_foot", kForce}, {"l_toes", kForce}});
  v.Add("torso_angle", "1", "Orientation of the pelvis in the world as a quaternion w, x, y, z.",
        {{"qw", {-1, 1}}, {"qx", {-1, 1}}, {"qy", {-1, 1}}, {"qz", {-1, 1}}});
  v.Add("opponent_pose", "m, rad",
        "Where the opponent is and how it is turned; at 0 rad it moves towards -y. The first "
        "observation of the profile that follows the official code shows zeros.",
        {{"x", kPlace}, {"y", kPlace}, {"angle", kAnyAngle}});
  v.Add("opponent_vel", "m/s, rad/s",
        "Its speed ahead and its turn. It moves at 2 m/s and 2 rad/s at most; in the profile that "
        "follows the official code larger numbers are what it wanted.",
        {{"ahead", {0, 100}}, {"turn", kSpeed}});
  v.Add("model_root_pos", "m", "The person's root in the world.", {{"x", kPlace}, {"y", kPlace}});
  v.Add("model_root_vel", "m/s", "Its velocity in the world's axes.",
        {{"x", kSpeed}, {"y", kSpeed}});
  v.Add("muscle_length", "m", "Lengths of the muscles with their tendons.",
        LayoutEntries(kLegsMuscles, {0, 2}));
  v.Add("muscle_velocity", "m/s", "Rates of the lengths, clipped to +-100.",
        LayoutEntries(kLegsMuscles, kClipped));
  v.Add("muscle_force", "kN", "Forces, negative when pulling, clipped to +-100.",
        LayoutEntries(kLegsMuscles, kClipped));
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kLegsMuscles, {0, 1}));
  return v;
}

VectorLayout Extra() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 20.01}}});
  v.Add("task", "1", "What the person is to do: 0 chase, 1 evade.", {{"", {0, 1}}});
  v.Add("hfield", "m",
        "Heights of the field on a grid around the root, 0.2 m apart, in the heading's frame, row "
        "by row, the first row 1 m ahead, the first column 1 m to the left.",
        HeightCells({-1, 1}));
  v.Add("state_opponent_pose", "m, rad",
        "opponent_pose of the state. These two are what the official dictionary has when the first "
        "observation shows zeros, and repeat the graded parts otherwise.",
        {{"x", kPlace}, {"y", kPlace}, {"angle", kAnyAngle}});
  v.Add("state_opponent_vel", "m/s, rad/s", "opponent_vel of the state.",
        {{"ahead", {0, 100}}, {"turn", kSpeed}});
  return v;
}

const TrackLayout& Layout() {
  static const TrackLayout layout = MuscleLayout(kLegsMuscles, Observation(), Extra());
  return layout;
}

}  // namespace
}  // namespace chasetag

const TrackKind& ChaseTagTrack() {
  static const TrackKind track = {.name = ChaseTagFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = chasetag::Layout,
                                  .no_facts = ChaseTagFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .template_year = 2023};
  return track;
}

}  // namespace myograde
