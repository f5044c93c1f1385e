// Writes the table of the leg's muscles, policies/baseline/leg_muscles.inc: MuJoCo's parameters of
// each muscle, and a polynomial of third order for its length over the joints that it crosses,
// fitted to the model's moment arms in random postures of walking.
//
//   write_leg_muscles CACHE > leg_muscles.inc
//
// Standard error has the largest error of each muscle's moment arms in mm, on postures that the fit
// has not seen. (It stands with the tests because policies don't know MuJoCo.)
#include <array>
#include <cstdio>
#include <iostream>
#include <random>
#include <vector>

#include "policies/baseline/length_terms.h"
#include "sim/locomotion/track.h"
#include "sim/model/model.h"
#include "tests/policies/baseline/muscle_fit.h"

namespace {

using myograde::baseline::JointRange;
using myograde::baseline::kFittedJoints;
using myograde::baseline::LengthTerms;
using myograde::baseline::Posture;

constexpr std::array<JointRange, kFittedJoints> kJoints = {{
    {"hip_flexion_r", -0.5, 1.2},
    {"hip_adduction_r", -0.4, 0.35},
    {"hip_rotation_r", -0.4, 0.4},
    {"hip_flexion_l", -0.5, 1.2},
    {"hip_adduction_l", -0.4, 0.35},
    {"hip_rotation_l", -0.4, 0.4},
    {"knee_angle_l", 0.0, 1.4},
    {"ankle_angle_l", -0.6, 0.5},
    {"subtalar_angle_l", -0.3, 0.3},
    {"mtp_angle_l", -0.4, 0.5},
}};
constexpr int kFitted = 600;
constexpr int kChecked = 200;
constexpr double kSmallestArm = 1e-5;  // m

// One entry of the table: name, joints, parameters of the muscle, weights in m.
void Write(const mjModel& model, int actuator, const std::vector<int>& joints,
           const std::vector<double>& weights) {
  const mjtNum* p = model.actuator_gainprm + actuator * mjNGAIN;
  const mjtNum* range = model.actuator_lengthrange + 2 * actuator;
  std::printf("{\"%s\",\n {", mj_id2name(&model, mjOBJ_ACTUATOR, actuator));
  for (size_t j = 0; j < joints.size(); ++j) std::printf(j == 0 ? "%d" : ", %d", joints[j]);
  std::printf("},\n {%.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g},\n {", p[2], p[0],
              p[1], range[0], range[1], p[4], p[5], p[6], p[7], p[8]);
  for (size_t t = 0; t < weights.size(); ++t) {
    const char* before = t == 0 ? "" : t % 9 == 0 ? ",\n  " : ", ";
    std::printf("%s%.6f", before, weights[t]);
  }
  std::printf("}},\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: write_leg_muscles CACHE\n";
    return 2;
  }
  auto model = myograde::sim::LoadModel(myograde::sim::LocomotionModel(), argv[1]);
  if (!model.ok()) {
    std::cerr << model.status().message() << "\n";
    return 1;
  }
  std::mt19937 random(1);
  // Above the ground: contacts are of no interest.
  myograde::baseline::PostureSampler sampler(**model, kJoints,
                                             [](mjData& data) { data.qpos[2] = 3; });
  const std::vector<Posture> fitted = sampler.Draw(kFitted, random);
  const std::vector<Posture> checked = sampler.Draw(kChecked, random);
  std::printf(
      "// Written by tests/policies/baseline/write_leg_muscles.cc. Of each muscle: name; "
      "joints;\n// force (N), range, lengths (m), lmin, lmax, vmax, fpmax, fvmax; "
      "weights of the terms (m).\n");
  for (int i = 0; i < std::ssize(sampler.muscles()); ++i) {
    const std::vector<int> joints =
        myograde::baseline::CrossedJoints(fitted, i, kFittedJoints, kSmallestArm);
    const LengthTerms terms(joints);
    const std::vector<double> weights = FitArms(fitted, i, terms);
    Write(**model, sampler.muscles()[i], joints, weights);
    std::fprintf(stderr, "%-14s %zu joints, error %.1f mm\n",
                 mj_id2name(model->get(), mjOBJ_ACTUATOR, sampler.muscles()[i]), joints.size(),
                 1000 * LargestError(checked, i, terms, weights));
  }
  return 0;
}
