#include "protocol/tracks/elbow/layout.h"

namespace myograde::layout_tables {
namespace {

// Three extensors, then three flexors: the official order.
constexpr std::string_view kElbowMuscles[] = {"TRIlong",  "TRIlat",   "TRImed",
                                              "BIClong", "BICshort", "BRA"};

// The joint's range is [0, 2.26893] rad; its upper stop gives way by 0.12 rad when all flexors
// pull at once.
constexpr Bounds kElbowAngle{-0.2, 2.5};
constexpr Bounds kElbowSpeed{-100, 100};  // rad/s: far above ordinary play

VectorLayout ElbowObservation() {
  VectorLayout v;
  v.Add("qpos", "rad", "Angle of the elbow: 0 is straight, flexion counts up.",
        {{"", kElbowAngle}});
  v.Add("qvel", "rad/s",
        "Velocity of the same joint (in the profile that follows the official code times 0.02 s, "
        "in rad).",
        {{"", kElbowSpeed}});
  v.Add("pose_err", "rad", "Target angle minus the elbow's angle.", {{"", {-2.5, 2.5}}});
  v.Add("act", "1", "Activations of the muscles.", Entries(kElbowMuscles, {0, 1}));
  return v;
}

VectorLayout ElbowAction() {
  VectorLayout v;
  v.Add("muscles", "1",
        "Excitation of each muscle. Normalized: a in [-1, 1] excites by 1/(1 + exp(-5(a - 0.5))); "
        "direct: the excitation itself, in [0, 1]. Below 0.001 it counts as 0.001.",
        Entries(kElbowMuscles, {-1, 1}));
  return v;
}

}  // namespace

TrackLayout ElbowLayout() {
  TrackLayout layout{
      .observation = ElbowObservation(), .action = ElbowAction(), .direct_bounds = {}};
  layout.direct_bounds.assign(std::size(kElbowMuscles), Bounds{0, 1});
  return layout;
}

}  // namespace myograde::layout_tables
