#include "protocol/tracks/elbow/track.h"

namespace myograde {
namespace elbow {
namespace {

// Three extensors, then three flexors: the official order.
constexpr std::string_view kMuscles[] = {"TRIlong",  "TRIlat",   "TRImed",
                                              "BIClong", "BICshort", "BRA"};

// The joint's range is [0, 2.26893] rad; its upper stop yields by 0.12 rad when all flexors pull at
// once.
constexpr Bounds kAngle{-0.2, 2.5};

VectorLayout Observation() {
  VectorLayout v;
  v.Add("qpos", "rad", "Angle of the elbow: 0 is straight, flexion counts up.",
        {{"", kAngle}});
  v.Add("qvel", "rad/s",
        "Velocity of the same joint (in the profile that follows the official code times 0.02 s, "
        "in rad).",
        {{"", kSpeed}});
  v.Add("pose_err", "rad", "Target angle minus the elbow's angle.", {{"", {-2.5, 2.5}}});
  v.Add("act", "1", "Activations of the muscles.", LayoutEntries(kMuscles, {0, 1}));
  return v;
}

VectorLayout Extra() {
  VectorLayout v;
  v.Add("time", "s", "Simulated time since the start of the episode.", {{"", {0, 2.01}}});
  return v;
}

VectorLayout Action() {
  VectorLayout v;
  v.Add("muscles", "1",
        "Excitation of each muscle. Normalized: a in [-1, 1] excites by 1/(1 + exp(-5(a - 0.5))); "
        "direct: the excitation itself, in [0, 1]. Below 0.001 it counts as 0.001.",
        LayoutEntries(kMuscles, {-1, 1}));
  return v;
}

TrackLayout Layout() {
  TrackLayout layout{.observation = Observation(),
                     .extra = Extra(),
                     .action = Action(),
                     .direct_bounds = {}};
  layout.direct_bounds.assign(std::size(kMuscles), Bounds{0, 1});
  return layout;
}

}  // namespace
}  // namespace elbow

const TrackLayout& ElbowLayout() {
  static const TrackLayout layout = elbow::Layout();
  return layout;
}

}  // namespace myograde
