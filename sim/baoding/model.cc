#include <string>

#include "sim/baoding/pins.h"
#include "sim/baoding/track.h"
#include "sim/model/hand.h"

namespace myograde::sim {
namespace baoding {
namespace {

// The targets are sites, which pictures leave out, so each gets a body that touches nothing. They
// come last, so that no number of a body or shape changes.
constexpr char kTargets[] =
    R"(<body name="target1" mocap="true"><geom type="sphere" size="0.007" group="2" )"
    R"(material="MatBallY" contype="0" conaffinity="0"/></body>)"
    R"(<body name="target2" mocap="true"><geom type="sphere" size="0.007" group="2" )"
    R"(material="MatBallP" contype="0" conaffinity="0"/></body>)";

absl::Status Patch(std::string& main, std::string&) {
  return InsertBefore(main, "<site name=\"move_target_site\"", kTargets);
}

}  // namespace
}  // namespace baoding

const ModelSource& BaodingModel() {
  static const ModelSource source = HandModel(
      "baoding", baoding::kPins, "envs/myo/assets/hand/myohand_baoding.xml", baoding::Patch);
  return source;
}

}  // namespace myograde::sim
