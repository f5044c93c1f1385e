// Writes the table of the arm's muscles, policies/baseline/arm_muscles.inc: MuJoCo's parameters of
// each muscle, and a polynomial of third order for its length over the joints that it crosses,
// fitted to the model's moment arms in random postures of reaching. The last entry is the arm's
// potential energy, whose slopes are the torques that carry its weight.
//
//   write_arm_muscles CACHE > arm_muscles.inc
//
// Standard error has the largest error of each muscle's moment arms in mm, on postures that the fit
// has not seen. (It stands with the tests because policies don't know MuJoCo.)
#include <array>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include "policies/baseline/arm_muscles.h"
#include "policies/baseline/length_terms.h"
#include "sim/manipulation/track.h"
#include "sim/model/model.h"
#include "tests/policies/baseline/muscle_fit.h"

namespace {

using myograde::baseline::JointRange;
using myograde::baseline::kArmJoints;
using myograde::baseline::LengthTerms;
using myograde::baseline::Posture;

constexpr std::array<JointRange, kArmJoints> kJoints = {{
    {"elv_angle", 0.0, 2.2},         {"shoulder_elv", 0.2, 1.5},
    {"shoulder_rot", -1.0, 1.9},     {"elbow_flexion", 0.2, 2.2},
    {"pro_sup", -1.2, 1.4},          {"deviation", -0.17, 0.43},
    {"flexion", -0.7, 0.85},         {"cmc_abduction", -0.5, 0.6},
    {"cmc_flexion", -0.7, 0.7},      {"mp_flexion", -0.7, 0.65},
    {"ip_flexion", -1.3, 0.4},       {"mcp2_flexion", 0.0, 1.57},
    {"mcp2_abduction", -0.26, 0.26}, {"pm2_flexion", 0.0, 1.57},
    {"md2_flexion", 0.0, 1.2},       {"mcp3_flexion", 0.0, 1.57},
    {"mcp3_abduction", -0.26, 0.26}, {"pm3_flexion", 0.0, 1.57},
    {"md3_flexion", 0.0, 1.2},       {"mcp4_flexion", 0.0, 1.57},
    {"mcp4_abduction", -0.26, 0.26}, {"pm4_flexion", 0.0, 1.57},
    {"md4_flexion", 0.0, 1.2},       {"mcp5_flexion", 0.0, 1.57},
    {"mcp5_abduction", -0.26, 0.26}, {"pm5_flexion", 0.0, 1.57},
    {"md5_flexion", 0.0, 1.2},
}};
constexpr int kFitted = 600;
constexpr int kChecked = 200;
constexpr double kSmallestArm = 1e-4;  // m
constexpr int kCarriers = 7;           // joints of the arm whose weight is in the table

std::vector<int> Crossed(const std::vector<Posture>& postures, int muscle) {
  const bool weight = muscle + 1 == postures.front().arms.rows();
  return myograde::baseline::CrossedJoints(postures, muscle, weight ? kCarriers : kArmJoints,
                                           kSmallestArm);
}

// What is missing of the lengths without a constant: its mean over the postures, in m.
double Constant(const std::vector<Posture>& postures, int muscle, const LengthTerms& terms,
                const std::vector<double>& weights) {
  double sum = 0;
  for (const Posture& p : postures) sum += p.lengths[muscle] - terms.Value(weights, p.angles);
  return sum / static_cast<double>(postures.size());
}

// One entry of the table: name, joints, parameters of the muscle, constant and weights in m.
void Write(const mjModel& model, int actuator, const std::vector<int>& joints, double constant,
           const std::vector<double>& weights) {
  std::printf("{\"%s\", {", actuator < 0 ? "weight" : mj_id2name(&model, mjOBJ_ACTUATOR, actuator));
  for (size_t j = 0; j < joints.size(); ++j) std::printf(j == 0 ? "%d" : ", %d", joints[j]);
  if (actuator < 0) {
    std::printf("}, {}, 0, {");
  } else {
    const mjtNum* p = model.actuator_gainprm + actuator * mjNGAIN;
    const mjtNum* range = model.actuator_lengthrange + 2 * actuator;
    std::printf("},\n {%.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g}, %.5f,\n {",
                p[2], p[0], p[1], range[0], range[1], p[4], p[5], p[6], p[7], p[8], constant);
  }
  int column = 2;
  for (size_t t = 0; t < weights.size(); ++t) {
    std::array<char, 32> digits;
    std::snprintf(digits.data(), digits.size(), "%.*f", actuator < 0 ? 3 : 5, weights[t]);
    std::string word = std::strtod(digits.data(), nullptr) == 0 ? "0" : digits.data();
    if (t + 1 < weights.size()) word += ",";
    if (column + std::ssize(word) > 98) {
      std::printf("\n  ");
      column = 2;
    }
    std::printf("%s", word.c_str());
    column += static_cast<int>(word.size());
  }
  std::printf("}},\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: write_arm_muscles CACHE\n";
    return 2;
  }
  auto model = myograde::sim::LoadModel(myograde::sim::ManipulationModel(), argv[1]);
  if (!model.ok()) {
    std::cerr << model.status().message() << "\n";
    return 1;
  }
  std::mt19937 random(1);
  myograde::baseline::PostureSampler sampler(**model, kJoints, [](mjData&) {});
  const std::vector<Posture> fitted = sampler.Draw(kFitted, random);
  const std::vector<Posture> checked = sampler.Draw(kChecked, random);
  std::printf(
      "// Written by tests/policies/baseline/write_arm_muscles.cc. Of each muscle: name; "
      "joints;\n// force (N), range, lengths (m), lmin, lmax, vmax, fpmax, fvmax; "
      "constant and weights\n// of the terms (m). The last: weights in J.\n");
  const int muscles = static_cast<int>(sampler.muscles().size());
  for (int i = 0; i <= muscles; ++i) {
    const int actuator = i < muscles ? sampler.muscles()[i] : -1;
    const std::vector<int> joints = Crossed(fitted, i);
    const LengthTerms terms(joints);
    const std::vector<double> weights = FitArms(fitted, i, terms);
    Write(**model, actuator, joints, Constant(fitted, i, terms, weights), weights);
    std::fprintf(stderr, "%-8s %zu joints, error %.1f mm\n",
                 actuator < 0 ? "weight" : mj_id2name(model->get(), mjOBJ_ACTUATOR, actuator),
                 joints.size(), 1000 * LargestError(checked, i, terms, weights));
  }
  return 0;
}
