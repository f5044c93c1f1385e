#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "sim/locomotion/pins.h"
#include "sim/locomotion/track.h"

namespace myograde::sim {
namespace locomotion {
namespace {

constexpr Inertial kInertials[] = {
    {"talus_l",
     0.021206492148821053,
     {0.0059372897449954925, 0.00034351215903711055, 0.0016839924396897746},
     {0.47334815046951917, 0.4674085875883708,
      0.5099967331359408, 0.5453201563177339},
     {4.212331307057108e-06, 2.9998630956762973e-06, 2.477388928751572e-06}},
    {"toes_l",
     0.2853650468083336,
     {0.022806223879799224, -0.00020971408036085006, -0.005249452995458072},
     {0.6511713149873308, 0.2856621959774136,
      0.28749311986703713, 0.6416546846678124},
     {0.0003771082776942644, 0.0003187077413671055, 0.00010057446038324882}},
    {"patella_l",
     0.027852860345448018,
     {0.0024746672076974927, 0.027966697449990842, -0.0007396985780579484},
     {0.6798944696690828, 0.7324377640641176,
      -0.025109725668787913, -0.025454539143167088},
     {6.768908001840843e-06, 4.7708258938528655e-06, 3.6348691387889737e-06}},
};

// The leg's two motors stand behind the muscles in the same block. The height
// field gets room for the widest course; the environment sets how much of it
// is used, and where.
absl::Status Patch(std::string& main, std::string& assets) {
  RETURN_IF_ERROR(Cut(main, "<hfield name=\"terrain\"", "/>").status());
  constexpr const char* kWideField =
      "<asset><hfield name=\"terrain\" size=\"1.5 60 1 0.001\" nrow=\"600\" "
      "ncol=\"30\"/></asset>\n";
  if (auto status = InsertBefore(main, "<worldbody>", kWideField); !status.ok()) return status;
  ASSIGN_OR_RETURN(auto block, Cut(assets, "<actuator>", "</actuator>"));
  std::string motors;
  for (const char* name : {"<motor name=\"osl_knee", "<motor name=\"osl_ankle"}) {
    ASSIGN_OR_RETURN(auto motor, Cut(block, name, "/>"));
    absl::StrAppend(&motors, motor, "\n");
  }
  block.insert(std::string_view("<actuator>").size(), "\n" + motors);
  return InsertBefore(assets, "</mujocoinclude>", block);
}

}  // namespace
}  // namespace locomotion

const ModelSource& LocomotionModel() {
  static const ModelSource source = {.name = "locomotion",
                                     .pins = locomotion::kPins,
                                     .main_file = "envs/myo/assets/leg/myoosl_runtrack.xml",
                                     .actuator_file =
                                         "simhive/myo_sim/osl/assets/myolegs_osl_assets.xml",
                                     .inertials = locomotion::kInertials,
                                     .buffers = {2000, 500, 5'000'000},
                                     .patch = locomotion::Patch};
  return source;
}

}  // namespace myograde::sim
