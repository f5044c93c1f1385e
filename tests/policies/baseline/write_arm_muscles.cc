// Writes the table of the arm's muscles, policies/baseline/arm_muscles.inc: MuJoCo's parameters of
// each muscle, and a polynomial of third order for its length over the joints that it crosses,
// fitted to the model's moment arms in random postures of reaching. The last entry is the arm's
// potential energy, whose slopes are the torques that carry its weight.
//
//   write_arm_muscles CACHE > arm_muscles.inc
//
// Standard error has the largest error of each muscle's moment arms in mm, on postures that the fit
// has not seen. (It stands with the tests because policies don't know MuJoCo.)
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include "policies/baseline/arm_muscles.h"
#include "policies/baseline/length_terms.h"
#include "sim/manipulation/model.h"
#include "sim/model/model.h"

namespace {

using myograde::baseline::kArmJoints;
using myograde::baseline::LengthTerms;

struct JointRange {
  const char* name;
  double low, high;  // rad, of the postures
};

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

// A joint that another one drags along by a polynomial (the shoulder blade).
struct Coupled {
  int joint;
  std::array<double, 5> polynomial;

  double At(double x) const {
    double value = 0;
    for (int k = 4; k >= 0; --k) value = value * x + polynomial[k];
    return value;
  }
  double Slope(double x) const {
    double slope = 0;
    for (int k = 4; k >= 1; --k) slope = slope * x + k * polynomial[k];
    return slope;
  }
};

std::vector<Coupled> CoupledTo(const mjModel& model, int joint) {
  std::vector<Coupled> out;
  for (int i = 0; i < model.neq; ++i) {
    if (model.eq_type[i] != mjEQ_JOINT || model.eq_obj2id[i] != joint) continue;
    Coupled coupled{model.eq_obj1id[i], {}};
    for (int k = 0; k < 5; ++k) coupled.polynomial[k] = model.eq_data[i * mjNEQDATA + k];
    out.push_back(coupled);
  }
  return out;
}

struct Posture {
  std::array<double, kArmJoints> angles{};
  Eigen::MatrixXd arms;     // muscles x joints, m; the last row is the torque of the weight, N m
  Eigen::VectorXd lengths;  // m; 0 for the last row
};

class Sampler {
 public:
  explicit Sampler(mjModel& model) : model_(model), data_(mj_makeData(&model)) {
    for (int j = 0; j < kArmJoints; ++j) {
      joint_[j] = mj_name2id(&model, mjOBJ_JOINT, kJoints[j].name);
      coupled_[j] = CoupledTo(model, joint_[j]);
    }
    for (int i = 0; i < model.nu; ++i) {
      if (model.actuator_dyntype[i] == mjDYN_MUSCLE) muscles_.push_back(i);
    }
  }
  const std::vector<int>& muscles() const { return muscles_; }

  std::vector<Posture> Draw(int count, std::mt19937& random) {
    std::vector<Posture> out;
    for (int i = 0; i < count; ++i) out.push_back(DrawOne(random));
    return out;
  }

 private:
  Posture DrawOne(std::mt19937& random) {
    Posture out;
    mj_resetData(&model_, data_.get());
    for (int j = 0; j < kArmJoints; ++j) {
      out.angles[j] = std::uniform_real_distribution(kJoints[j].low, kJoints[j].high)(random);
      data_->qpos[model_.jnt_qposadr[joint_[j]]] = out.angles[j];
      for (const Coupled& c : coupled_[j]) {
        data_->qpos[model_.jnt_qposadr[c.joint]] = c.At(out.angles[j]);
      }
    }
    mj_forward(&model_, data_.get());
    const auto muscles = std::ssize(muscles_);
    out.arms.resize(muscles + 1, kArmJoints);
    out.lengths = Eigen::VectorXd::Zero(muscles + 1);
    for (int i = 0; i < muscles; ++i) out.lengths[i] = data_->actuator_length[muscles_[i]];
    for (int i = 0; i <= muscles; ++i) {
      const mjtNum* moment =
          i < muscles ? data_->actuator_moment + muscles_[i] * model_.nv : data_->qfrc_bias;
      for (int j = 0; j < kArmJoints; ++j) {
        double arm = moment[model_.jnt_dofadr[joint_[j]]];
        for (const Coupled& c : coupled_[j]) {
          arm += moment[model_.jnt_dofadr[c.joint]] * c.Slope(out.angles[j]);
        }
        out.arms(i, j) = arm;
      }
    }
    return out;
  }

  mjModel& model_;
  myograde::sim::DataPtr data_;
  std::array<int, kArmJoints> joint_;
  std::array<std::vector<Coupled>, kArmJoints> coupled_;
  std::vector<int> muscles_;
};

std::vector<int> Crossed(const std::vector<Posture>& postures, int muscle) {
  std::vector<int> out;
  const bool weight = muscle + 1 == postures.front().arms.rows();
  for (int j = 0; j < (weight ? kCarriers : kArmJoints); ++j) {
    double largest = 0;
    for (const Posture& p : postures) largest = std::max(largest, std::abs(p.arms(muscle, j)));
    if (largest > kSmallestArm) out.push_back(j);
  }
  return out;
}

std::vector<double> ArmsOf(const LengthTerms& terms, const std::vector<double>& weights,
                           const Posture& posture) {
  std::vector<double> arms(terms.joints());
  terms.AddSlopes(weights, posture.angles, arms);
  return arms;
}

std::vector<double> Fit(const std::vector<Posture>& postures, int muscle,
                        const LengthTerms& terms) {
  const int joints = terms.joints();
  Eigen::MatrixXd slopes(std::ssize(postures) * joints, terms.size());
  Eigen::VectorXd arms(slopes.rows());
  for (int t = 0; t < terms.size(); ++t) {
    std::vector<double> unit(terms.size());
    unit[t] = 1;
    for (int i = 0; i < std::ssize(postures); ++i) {
      const std::vector<double> column = ArmsOf(terms, unit, postures[i]);
      for (int j = 0; j < joints; ++j) slopes(i * joints + j, t) = column[j];
    }
  }
  for (int i = 0; i < std::ssize(postures); ++i) {
    for (int j = 0; j < joints; ++j) {
      arms[i * joints + j] = postures[i].arms(muscle, terms.joint(j));
    }
  }
  const Eigen::VectorXd weights = slopes.colPivHouseholderQr().solve(arms);
  return {weights.begin(), weights.end()};
}

double LargestError(const std::vector<Posture>& postures, int muscle, const LengthTerms& terms,
                    const std::vector<double>& weights) {
  double largest = 0;
  for (const Posture& p : postures) {
    const std::vector<double> arms = ArmsOf(terms, weights, p);
    for (int j = 0; j < terms.joints(); ++j) {
      largest = std::max(largest, std::abs(arms[j] - p.arms(muscle, terms.joint(j))));
    }
  }
  return largest;
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
  Sampler sampler(**model);
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
    const std::vector<double> weights = Fit(fitted, i, terms);
    Write(**model, actuator, joints, Constant(fitted, i, terms, weights), weights);
    std::fprintf(stderr, "%-8s %zu joints, error %.1f mm\n",
                 actuator < 0 ? "weight" : mj_id2name(model->get(), mjOBJ_ACTUATOR, actuator),
                 joints.size(), 1000 * LargestError(checked, i, terms, weights));
  }
  return 0;
}
