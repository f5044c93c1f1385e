#include <absl/strings/str_cat.h>

#include <string>

#include "protocol/base/status_macros.h"
#include "sim/model/hand.h"
#include "sim/reorientation/pins.h"
#include "sim/reorientation/track.h"

namespace myograde::sim {
namespace reorientation {
namespace {

// The three plates that make the die's sides, and their colours: without its texture nobody would
// see how it lies.
constexpr const char* kPlates[][2] = {{".0284 .0236 .0236", "0.80 0.25 0.20 1"},
                                       {".0236 .0284 .0236", "0.25 0.60 0.30 1"},
                                       {".0236 .0236 .0284", "0.20 0.40 0.75 1"}};

// The goal is placed anew by each reset, so it is a body of its own for pictures, with plates like
// the die's that touch nothing. No number that the physics reads changes.
absl::Status Patch(std::string& main, std::string&) {
  const std::string material = "\" material=\"MatDice\"";
  std::string plates;
  for (const auto& [size, colour] : kPlates) {
    const std::string plate = absl::StrCat("<geom type=\"box\" group=\"2\" size=\"", size);
    RETURN_IF_ERROR(Cut(main, plate + material, "/>").status());
    const std::string coloured = absl::StrCat(plate, "\" rgba=\"", colour, "\"");
    RETURN_IF_ERROR(InsertBefore(main, "<joint name=\"OBJTx\"", coloured + "/>"));
    absl::StrAppend(&plates, coloured, " contype=\"0\" conaffinity=\"0\"/>");
  }
  RETURN_IF_ERROR(InsertBefore(main, "<site name=\"target_ball\"", plates));
  return InsertBefore(main, " pos=\"-.340 -.535 1.46\"", " mocap=\"true\"");
}

}  // namespace
}  // namespace reorientation

const ModelSource& ReorientationModel() {
  static const ModelSource source =
      HandModel("reorientation", reorientation::kPins, "envs/myo/assets/hand/myohand_die.xml",
                reorientation::Patch);
  return source;
}

}  // namespace myograde::sim
