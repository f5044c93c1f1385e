// How torques of joints are shared out among muscles, for legs and arms.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>

#include "policies/baseline/length_terms.h"
#include "policies/baseline/muscle_curves.h"

namespace myograde::baseline {

// Coordinate descent, `sweeps` times over all muscles, on the squared torque that is missing, times
// `weight` of each joint, plus `effort` times the squared activations. `muscles[i].terms` has the
// joints of muscle i, `torque[i]` its torques at full activation (N m), in the same order. Changes
// `activations`, one for each muscle, within `bounds`, and with them `missing` (N m), which fits
// them before and after.
template <typename Table, size_t kCount, size_t kMost, size_t kWidth>
void ShareTorques(const Table& muscles, const std::array<std::array<double, kMost>, kCount>& torque,
                  const std::array<ActivationBounds, kCount>& bounds,
                  const std::array<double, kWidth>& weight, double effort, int sweeps,
                  std::array<double, kWidth>& missing, std::span<double> activations) {
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (size_t i = 0; i < activations.size(); ++i) {
      const LengthTerms& terms = muscles[i].terms;
      double slope = -effort * activations[i], curvature = effort;
      for (int j = 0; j < terms.joints(); ++j) {
        const double weighted = weight[terms.joint(j)] * torque[i][j];
        slope += weighted * missing[terms.joint(j)];
        curvature += weighted * torque[i][j];
      }
      const double next =
          std::clamp(activations[i] + slope / curvature, bounds[i].low, bounds[i].high);
      for (int j = 0; j < terms.joints(); ++j) {
        missing[terms.joint(j)] -= torque[i][j] * (next - activations[i]);
      }
      activations[i] = next;
    }
  }
}

}  // namespace myograde::baseline
