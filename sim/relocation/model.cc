#include "sim/model/hand.h"
#include "sim/relocation/pins.h"
#include "sim/relocation/relocation.h"

namespace myograde::sim {

const ModelSource& RelocationModel() {
  static const ModelSource source = {
      .name = "relocation",
      .pins = relocation::kPins,
      .main_file = "envs/myo/assets/arm/myoarm_relocate.xml",
      .actuator_file = "simhive/myo_sim/arm/assets/myoarm_assets.xml",
      .inertials = kHandInertials,
      .buffers = {1000, 400, 1'000'000}};
  return source;
}

}  // namespace myograde::sim
