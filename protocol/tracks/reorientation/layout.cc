#include "protocol/tracks/hand.h"
#include "protocol/tracks/reorientation/track.h"

namespace myograde {
namespace reorientation {
namespace {

VectorLayout Observation() {
  const std::vector<LayoutEntry> place = LayoutEntries(kAxes, {-3, 3});  // m: well inside
  const std::vector<LayoutEntry> angles = LayoutEntries(kAngles, kAnyAngle);
  VectorLayout v;
  v.Add("hand_qpos_noMD5", "rad",
        "Joint angles of the hand, without the last joint of the little finger, which the official "
        "code leaves out by mistake.",
        AllOf(std::span(kHandJoints).first<std::size(kHandJoints) - 1>()));
  v.Add("hand_qvel", "rad/s",
        "Velocities of all joints of the hand (in the profile that follows the official code times "
        "0.01 s, in rad).",
        EntriesWith(kHandJoints, kSpeed));
  v.Add("obj_pos", "m", "Centre of the die in the world.", place);
  v.Add("goal_pos", "m",
        "Centre of the goal die in the world, which is shown 0.1 m beside the place that is meant.",
        place);
  v.Add("pos_err", "m", "From the die to its place: goal_pos minus obj_pos plus (0.1, 0, 0).", place);
  v.Add("obj_rot", "rad", "Orientation of the die in the world, as Euler angles.", angles);
  v.Add("goal_rot", "rad", "Orientation of the goal die, likewise.", angles);
  v.Add("rot_err", "rad",
        "goal_rot minus obj_rot, angle by angle; not wrapped in the profile that follows the "
        "official code.",
        LayoutEntries(kAngles, kAnyRotation));
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kHandMuscles, {0, 1}));
  return v;
}

VectorLayout Extra() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 1.51}}});
  v.Add("hand_qpos", "rad", "Joint angles of the hand, all of them.",
        AllOf(kHandJoints));
  return v;
}

const TrackLayout& Layout() {
  static const TrackLayout layout = MuscleLayout(kHandMuscles, Observation(), Extra());
  return layout;
}

}  // namespace
}  // namespace reorientation

const TrackKind& ReorientationTrack() {
  static const TrackKind track = {.name = ReorientationFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = reorientation::Layout,
                                  .no_facts = ReorientationFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .template_year = 2022};
  return track;
}

}  // namespace myograde
