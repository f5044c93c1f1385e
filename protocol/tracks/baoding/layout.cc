#include "protocol/tracks/baoding/track.h"
#include "protocol/tracks/hand.h"

namespace myograde {
namespace baoding {
namespace {

VectorLayout Observation() {
  const std::vector<LayoutEntry> place = LayoutEntries(kAxes, {-3, 3});  // m: well inside
  const std::vector<LayoutEntry> speed = LayoutEntries(kAxes, {-10, 10});
  VectorLayout v;
  v.Add("hand_pos", "rad", "Joint angles of the hand.", AllOf(kHandJoints));
  v.Add("object1_pos", "m", "Centre of the first ball in the world.", place);
  v.Add("object1_velp", "m/s",
        "Its velocity (in the profile that follows the official code times 0.025 s, in m).", speed);
  v.Add("object2_pos", "m", "Centre of the second ball in the world.", place);
  v.Add("object2_velp", "m/s", "Its velocity, likewise.", speed);
  v.Add("target1_pos", "m",
        "Where the first ball's centre should be, in the world. In the profile that follows the "
        "official code, one step late, and not yet of this episode in the first observation.",
        place);
  v.Add("target2_pos", "m", "The same of the second ball.", place);
  v.Add("target1_err", "m", "target1_pos minus object1_pos.", place);
  v.Add("target2_err", "m", "target2_pos minus object2_pos.", place);
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kHandMuscles, {0, 1}));
  return v;
}

VectorLayout Extra() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 5.01}}});
  return v;
}

const TrackLayout& Layout() {
  static const TrackLayout layout = MuscleLayout(kHandMuscles, Observation(), Extra());
  return layout;
}

}  // namespace
}  // namespace baoding

const TrackKind& BaodingTrack() {
  static const TrackKind track = {.name = BaodingFacts::kTrack,
                                  .control_period_s = 0.025,
                                  .layout = baoding::Layout,
                                  .no_facts = BaodingFacts(),
                                  .max_steps = MaxStepsKey,
                                  .tables = nullptr,
                                  .template_year = 2022};
  return track;
}

}  // namespace myograde
