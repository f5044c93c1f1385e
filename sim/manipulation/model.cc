#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "sim/manipulation/pins.h"
#include "sim/manipulation/track.h"
#include "sim/model/hand.h"

namespace myograde::sim {
namespace manipulation {
namespace {

constexpr Inertial kInertials[] = {
    kLunate,
    kCapitate,
    {"prosthesis/Lmpl_attach",
     0.43029215707149565,
     {-0.00314232349641597, -0.0010174463154082717, 0.07449351390368959},
     {0.5087976874200667, -0.01291302080976688,
      -0.016404935409189754, 0.860632932941669},
     {0.0004268319677210332, 0.0004106976602362853, 0.0002743413529975065}},
    {"prosthesis/Lshoulder_link",
     0.24964898913272196,
     {0.00015578997863933825, 0.0002724685389915625, -0.0014354992958311838},
     {0.6913605603740194, 0.7159047863438854,
      0.06788661041900165, -0.06994512545600662},
     {0.00017057175628686048, 0.00016445410149389358, 0.00014204174179685138}},
    {"prosthesis/Lhumerus_upper_link",
     0.9367135681210536,
     {-0.0016720554613245625, -0.06954987801839388, -0.010551968637044327},
     {0.49122046819132126, 0.5165286464720799,
      -0.5103443183540551, 0.48109176435203604},
     {0.0021927465442128035, 0.0021347006352759397, 0.0009060424105050914}},
    {"prosthesis/Lhumerus_lower_link",
     0.38918054801832713,
     {-0.0003329151595428313, -0.0603581827897504, 0.0038422542058139425},
     {0.35044862975971525, 0.32336359301626777,
      -0.5565796958842452, 0.6803240306946013},
     {0.0009452897157193219, 0.0009246517620363288, 0.00020924724477062686}},
    {"prosthesis/Lforearm_link",
     0.9306372540420899,
     {-0.0007144879521428354, -0.07688360080142716, -0.0029929954404166134},
     {0.5719644655416318, 0.5515950241881669,
      -0.4181091773514166, 0.4402093766187322},
     {0.003666001881040931, 0.0036494739730360396, 0.0006459458239131073}},
    {"manip_object",
     0.27006089218076124,
     {0.0006956123134428037, 0.000636476667404347, 0.013921922679199224},
     {0.5032445263614351, 0.49737950489622906,
      -0.5041731962321663, 0.4951443860102611},
     {0.00028552480135660694, 0.00018780053585397636, 0.00013254504035928473}},
};

// MuJoCo 2.2.2 wants actuators without activation before those with one.
// The arm's muscles come from a file before the prosthesis' servos: the whole
// block moves to the end of the main file. (Moving the includes instead would
// change which defaults apply and the order of tendons and meshes.)
absl::Status Patch(std::string& main, std::string& assets) {
  ASSIGN_OR_RETURN(auto actuators, Cut(assets, "<actuator>", "</actuator>"));
  return InsertBefore(main, "</mujoco>", actuators);
}

}  // namespace
}  // namespace manipulation

const ModelSource& ManipulationModel() {
  static const ModelSource source = {.name = "manipulation",
                                     .pins = manipulation::kPins,
                                     .main_file = "envs/myo/assets/arm/myoarm_bionic_bimanual.xml",
                                     .actuator_file =
                                         "simhive/myo_sim/arm/assets/myoarm_assets.xml",
                                     .inertials = manipulation::kInertials,
                                     .buffers = {1000, 400, 3'000'000},
                                     .patch = manipulation::Patch};
  return source;
}

}  // namespace myograde::sim
