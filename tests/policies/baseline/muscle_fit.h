// What the writers of the baselines' tables of muscles have in common: postures of the model at
// random, and the polynomial of a muscle's length that fits its moment arms in them.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "policies/baseline/length_terms.h"
#include "sim/model/model.h"

namespace myograde::baseline {

struct JointRange {
  const char* name;
  double low, high;  // rad, of the postures
};

// A joint that another one drags along by a polynomial (the knee's own rolling, the patella, the
// shoulder blade).
struct CoupledJoint {
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

inline std::vector<CoupledJoint> CoupledTo(const mjModel& model, int joint) {
  std::vector<CoupledJoint> out;
  for (int i = 0; i < model.neq; ++i) {
    if (model.eq_type[i] != mjEQ_JOINT || model.eq_obj2id[i] != joint) continue;
    CoupledJoint coupled{model.eq_obj1id[i], {}};
    for (int k = 0; k < 5; ++k) coupled.polynomial[k] = model.eq_data[i * mjNEQDATA + k];
    out.push_back(coupled);
  }
  return out;
}

struct Posture {
  std::vector<double> angles;  // rad, of the sampled joints
  Eigen::MatrixXd arms;        // muscles x joints, m; the last row is the torque of the weight, N m
  Eigen::VectorXd lengths;     // m; 0 for the last row
};

class PostureSampler {
 public:
  // `joints` stay where they are. `place`: sets of a posture what its angles leave open.
  PostureSampler(mjModel& model, std::span<const JointRange> joints,
                 std::function<void(mjData&)> place)
      : model_(model), data_(mj_makeData(&model)), joints_(joints), place_(std::move(place)) {
    for (const JointRange& own : joints) {
      const int joint = mj_name2id(&model, mjOBJ_JOINT, own.name);
      ids_.push_back(joint);
      coupled_.push_back(CoupledTo(model, joint));
    }
    for (int i = 0; i < model.nu; ++i) {
      if (model.actuator_dyntype[i] == mjDYN_MUSCLE) muscles_.push_back(i);
    }
  }
  const std::vector<int>& muscles() const { return muscles_; }  // their actuators

  std::vector<Posture> Draw(int count, std::mt19937& random) {
    std::vector<Posture> out;
    for (int i = 0; i < count; ++i) out.push_back(DrawOne(random));
    return out;
  }

 private:
  Posture DrawOne(std::mt19937& random) {
    Posture out;
    mj_resetData(&model_, data_.get());
    place_(*data_);
    for (size_t j = 0; j < joints_.size(); ++j) {
      const double angle = std::uniform_real_distribution(joints_[j].low, joints_[j].high)(random);
      out.angles.push_back(angle);
      data_->qpos[model_.jnt_qposadr[ids_[j]]] = angle;
      for (const CoupledJoint& c : coupled_[j]) {
        data_->qpos[model_.jnt_qposadr[c.joint]] = c.At(angle);
      }
    }
    mj_forward(&model_, data_.get());
    const auto muscles = std::ssize(muscles_);
    out.arms.resize(muscles + 1, std::ssize(joints_));
    out.lengths = Eigen::VectorXd::Zero(muscles + 1);
    for (int i = 0; i < muscles; ++i) out.lengths[i] = data_->actuator_length[muscles_[i]];
    for (int i = 0; i <= muscles; ++i) {
      const mjtNum* moment =
          i < muscles ? data_->actuator_moment + muscles_[i] * model_.nv : data_->qfrc_bias;
      for (size_t j = 0; j < joints_.size(); ++j) {
        double arm = moment[model_.jnt_dofadr[ids_[j]]];
        for (const CoupledJoint& c : coupled_[j]) {
          arm += moment[model_.jnt_dofadr[c.joint]] * c.Slope(out.angles[j]);
        }
        out.arms(i, j) = arm;
      }
    }
    return out;
  }

  mjModel& model_;
  sim::DataPtr data_;
  std::span<const JointRange> joints_;
  std::function<void(mjData&)> place_;
  std::vector<int> ids_;
  std::vector<std::vector<CoupledJoint>> coupled_;
  std::vector<int> muscles_;
};

// The first `count` joints less those over which the muscle never has an arm of more than `least`
// (m, or N m of the weight).
inline std::vector<int> CrossedJoints(const std::vector<Posture>& postures, int muscle, int count,
                                      double least) {
  std::vector<int> out;
  for (int j = 0; j < count; ++j) {
    double largest = 0;
    for (const Posture& p : postures) largest = std::max(largest, std::abs(p.arms(muscle, j)));
    if (largest > least) out.push_back(j);
  }
  return out;
}

inline std::vector<double> ArmsOf(const LengthTerms& terms, const std::vector<double>& weights,
                                  const Posture& posture) {
  std::vector<double> arms(terms.joints());
  terms.AddSlopes(weights, posture.angles, arms);
  return arms;
}

// The weights of the terms, in m, whose slopes are nearest to the muscle's arms.
inline std::vector<double> FitArms(const std::vector<Posture>& postures, int muscle,
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

// Of the fitted arms in other postures, in m.
inline double LargestError(const std::vector<Posture>& postures, int muscle,
                           const LengthTerms& terms, const std::vector<double>& weights) {
  double largest = 0;
  for (const Posture& p : postures) {
    const std::vector<double> arms = ArmsOf(terms, weights, p);
    for (int j = 0; j < terms.joints(); ++j) {
      largest = std::max(largest, std::abs(arms[j] - p.arms(muscle, terms.joint(j))));
    }
  }
  return largest;
}

}  // namespace myograde::baseline
