#include "protocol/tracks/arm.h"
#include "protocol/tracks/relocation/track.h"

namespace myograde {
namespace relocation {
namespace {

VectorLayout Observation() {
  const std::vector<LayoutEntry> place = LayoutEntries(kAxes, {-3, 3});  // m: well inside
  const std::vector<LayoutEntry> angles = LayoutEntries(kAngles, kAnyAngle);
  VectorLayout v;
  v.Add("hand_qpos", "rad",
        "Joint angles of arm and hand, without the last joint of the little finger, which the "
        "official code leaves out by mistake.",
        AllOf(std::span(kArmJoints).first<std::size(kArmJoints) - 1>()));
  v.Add("hand_qvel", "rad/s",
        "Velocities of all joints of arm and hand (in the profile that follows the official code "
        "times 0.01 s, in rad).",
        EntriesWith(kArmJoints, kSpeed));
  v.Add("obj_pos", "m", "The object's frame in the world.", place);
  v.Add("goal_pos", "m",
        "The goal in the world: the middle of the bin's floor, 0.01 m below its face.", place);
  v.Add("pos_err", "m", "From the object to the goal: goal_pos minus obj_pos.", place);
  v.Add("obj_rot", "rad", "Orientation of the object's frame in the world, as Euler angles.",
        angles);
  v.Add("goal_rot", "rad", "Orientation of the bin, likewise.", angles);
  v.Add("rot_err", "rad",
        "goal_rot minus obj_rot, angle by angle; not wrapped in the profile that follows the "
        "official code.",
        LayoutEntries(kAngles, kAnyRotation));
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kArmMuscles, {0, 1}));
  return v;
}

VectorLayout Extra() {
  const std::vector<LayoutEntry> place = LayoutEntries(kAxes, {-3, 3});
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 1.51}}});
  v.Add("hand_qpos_corrected", "rad", "Joint angles of arm and hand, all of them.",
        AllOf(kArmJoints));
  v.Add("palm_pos", "m", "The palm in the world.", place);
  v.Add("reach_err", "m", "From the object to the palm: palm_pos minus obj_pos.", place);
  const std::vector<LayoutEntry> angles = LayoutEntries(kAngles, kAnyAngle);
  v.Add("state_obj_pos", "m",
        "obj_pos of the state. These six are what the official dictionary has when the first "
        "observation is of another draw, and repeat the graded parts otherwise.",
        place);
  v.Add("state_goal_pos", "m", "goal_pos of the state.", place);
  v.Add("state_pos_err", "m", "pos_err of the state.", place);
  v.Add("state_obj_rot", "rad", "obj_rot of the state.", angles);
  v.Add("state_goal_rot", "rad", "goal_rot of the state.", angles);
  v.Add("state_rot_err", "rad", "rot_err of the state.",
        LayoutEntries(kAngles, kAnyRotation));
  return v;
}

const TrackLayout& Layout() {
  static const TrackLayout layout = MuscleLayout(kArmMuscles, Observation(), Extra());
  return layout;
}

}  // namespace
}  // namespace relocation

const TrackKind& RelocationTrack() {
  static const TrackKind track = {.name = RelocationFacts::kTrack,
                                  .control_period_s = 0.01,
                                  .layout = relocation::Layout,
                                  .no_facts = RelocationFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .template_year = 2023};
  return track;
}

}  // namespace myograde
