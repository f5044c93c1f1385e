// Writes the table of the leg's muscles, policies/baseline/leg_muscles.inc: MuJoCo's parameters of
// each muscle, and a polynomial of third order for its length over the joints that it crosses, fitted to
// the model's moment arms in random postures of walking.
//
//   write_leg_muscles CACHE > leg_muscles.inc
//
// Standard error has the largest error of each muscle's moment arms in mm, on postures that the fit
// has not seen. (It stands with the tests because policies don't know MuJoCo.)
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "policies/baseline/length_terms.h"
#include "sim/locomotion/model.h"
#include "sim/model/model.h"

namespace {

using myograde::baseline::kLengthJoints;
using myograde::baseline::LengthTerms;

struct JointRange {
  const char* name;
  double low, high;  // rad, of the postures
};

constexpr std::array<JointRange, kLengthJoints> kJoints = {{
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

// A joint that another one drags along by a polynomial (the knee's own rolling, the patella).
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
  std::array<double, kLengthJoints> angles;
  Eigen::MatrixXd arms;  // muscles x joints, m
};

class Sampler {
 public:
  explicit Sampler(mjModel& model) : model_(model), data_(mj_makeData(&model)) {
    for (int j = 0; j < kLengthJoints; ++j) {
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
    data_->qpos[2] = 3;  // above the ground: contacts are of no interest
    for (int j = 0; j < kLengthJoints; ++j) {
      out.angles[j] = std::uniform_real_distribution(kJoints[j].low, kJoints[j].high)(random);
      data_->qpos[model_.jnt_qposadr[joint_[j]]] = out.angles[j];
      for (const Coupled& c : coupled_[j]) {
        data_->qpos[model_.jnt_qposadr[c.joint]] = c.At(out.angles[j]);
      }
    }
    mj_forward(&model_, data_.get());
    out.arms.resize(std::ssize(muscles_), kLengthJoints);
    for (int i = 0; i < std::ssize(muscles_); ++i) {
      const mjtNum* moment = data_->actuator_moment + muscles_[i] * model_.nv;
      for (int j = 0; j < kLengthJoints; ++j) {
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
  std::array<int, kLengthJoints> joint_;
  std::array<std::vector<Coupled>, kLengthJoints> coupled_;
  std::vector<int> muscles_;
};

std::vector<int> Crossed(const std::vector<Posture>& postures, int muscle) {
  std::vector<int> out;
  for (int j = 0; j < kLengthJoints; ++j) {
    double largest = 0;
    for (const Posture& p : postures) largest = std::max(largest, std::abs(p.arms(muscle, j)));
    if (largest > 1e-5) out.push_back(j);
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
  Sampler sampler(**model);
  const std::vector<Posture> fitted = sampler.Draw(kFitted, random);
  const std::vector<Posture> checked = sampler.Draw(kChecked, random);
  std::printf("// Written by tests/policies/baseline/write_leg_muscles.cc. Of each muscle: name; "
              "joints;\n// force (N), range, lengths (m), lmin, lmax, vmax, fpmax, fvmax; "
              "weights of the terms (m).\n");
  for (int i = 0; i < std::ssize(sampler.muscles()); ++i) {
    const std::vector<int> joints = Crossed(fitted, i);
    const LengthTerms terms(joints);
    const std::vector<double> weights = Fit(fitted, i, terms);
    Write(**model, sampler.muscles()[i], joints, weights);
    std::fprintf(stderr, "%-14s %zu joints, error %.1f mm\n",
                 mj_id2name(model->get(), mjOBJ_ACTUATOR, sampler.muscles()[i]), joints.size(),
                 1000 * LargestError(checked, i, terms, weights));
  }
  return 0;
}
