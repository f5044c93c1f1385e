// The length of a muscle as a polynomial of third order over the joints that it crosses.
#pragma once

#include <array>
#include <span>
#include <utility>
#include <vector>

namespace myograde::baseline {

// The joints of the walker's table, in its order: right hip (flexion, adduction, rotation), left
// hip (the same), left knee, ankle, subtalar joint and toes. A person with two whole legs has the
// last four on the right, too.
inline constexpr int kFittedJoints = 10;
inline constexpr int kLengthJoints = 14;
inline constexpr int kMostJoints = 10;  // that one muscle crosses

// The monomials of first to third order over some of those joints.
class LengthTerms {
 public:
  // `joints`: indices of joints, ascending, at most kMostJoints.
  explicit LengthTerms(std::vector<int> joints) : joints_(std::move(joints)) {
    const int n = static_cast<int>(joints_.size());
    for (int a = 0; a < n; ++a) factors_.push_back({a, n, n});
    for (int a = 0; a < n; ++a) {
      for (int b = a; b < n; ++b) factors_.push_back({a, b, n});
    }
    for (int a = 0; a < n; ++a) {
      for (int b = a; b < n; ++b) {
        for (int c = b; c < n; ++c) factors_.push_back({a, b, c});
      }
    }
  }

  int size() const { return static_cast<int>(factors_.size()); }
  int joints() const { return static_cast<int>(joints_.size()); }
  int joint(int local) const { return joints_[local]; }

  // Adds weight times the slope of every term to arms[local joint]: moment arms in m for weights in
  // m and `angles` (kLengthJoints entries) in rad.
  void AddSlopes(std::span<const double> weights, std::span<const double> angles,
                 std::span<double> arms) const {
    const int n = joints();
    std::array<double, kMostJoints + 1> x{};
    for (int j = 0; j < n; ++j) x[j] = angles[joints_[j]];
    x[n] = 1;  // what a term of lower order is multiplied with
    for (int t = 0; t < size(); ++t) {
      const auto [a, b, c] = factors_[t];
      arms[a] += weights[t] * x[b] * x[c];
      if (b < n) arms[b] += weights[t] * x[a] * x[c];
      if (c < n) arms[c] += weights[t] * x[a] * x[b];
    }
  }

  // The sum of weight times term, without a constant: a length in m for weights in m.
  double Value(std::span<const double> weights, std::span<const double> angles) const {
    const int n = joints();
    std::array<double, kMostJoints + 1> x{};
    for (int j = 0; j < n; ++j) x[j] = angles[joints_[j]];
    x[n] = 1;
    double sum = 0;
    for (int t = 0; t < size(); ++t) {
      const auto [a, b, c] = factors_[t];
      sum += weights[t] * x[a] * x[b] * x[c];
    }
    return sum;
  }

 private:
  std::vector<int> joints_;
  std::vector<std::array<int, 3>> factors_;  // local joints; joints() stands for none
};

}  // namespace myograde::baseline
