#include "sim/chasetag/field.h"

#include <cmath>
#include <numbers>

namespace myograde::sim {
namespace {

enum Kind : uint32_t { kFlat, kHilly, kRough, kKinds };
constexpr int kMostHilly = 2;

template <typename Samples>
Samples Normalised(const Samples& samples) {
  const double low = samples.minCoeff();
  return (samples - low) / (samples.maxCoeff() - low);
}

}  // namespace

ChaseTagField::ChaseTagField(std::string_view relief) {
  heights_.setZero();
  for (size_t i = 0; i < relief.size(); ++i) {
    relief_.data()[i] = static_cast<uint8_t>(relief[i]);
  }
  relief_ = Patch(Normalised(relief_).colwise().reverse());
  // numpy.linspace(0, 10 pi, n), backwards: multiples of one step, the last value exact.
  constexpr double kLast = 10 * std::numbers::pi;
  const auto n = static_cast<int>(hills_.size());
  for (int i = 0; i < n; ++i) {
    const double phase = i == n - 1 ? kLast : i * (kLast / (n - 1));
    hills_.data()[n - 1 - i] = std::sin(phase + std::numbers::pi / 2) - 1;
  }
  hills_ = Normalised(hills_);
}

void ChaseTagField::Draw(const ChaseTagRules& rules, NumpyGenerator& generator) {
  int hilly = 0;
  for (int row = 0; row < kPatches; ++row) {
    for (int column = 0; column < kPatches; ++column) {
      uint32_t kind = generator.Integers(kKinds);
      while (kind == kHilly && hilly >= kMostHilly) kind = generator.Integers(kKinds);
      hilly += kind == kHilly;
      drawn_.setZero();
      if (kind == kHilly) DrawHills(rules, generator);
      if (kind == kRough) DrawRoughness(rules, generator);
      At(row, column) = drawn_.cast<float>();
    }
  }
  if (generator.Random() < rules.relief_share) {
    const auto row = static_cast<int>(generator.Integers(kPatches));
    const auto column = static_cast<int>(generator.Integers(kPatches));
    const double height = generator.Uniform(rules.relief_m[0], rules.relief_m[1]);
    At(row, column) = (relief_ * height).cast<float>();
  }
}

// Five waves along the rows, or, turned, along the columns.
void ChaseTagField::DrawHills(const ChaseTagRules& rules, NumpyGenerator& generator) {
  drawn_ = hills_ * generator.Uniform(rules.hills_m[0], rules.hills_m[1]);
  if (generator.Random() < 0.5) drawn_ = Patch(drawn_.transpose().colwise().reverse());
}

void ChaseTagField::DrawRoughness(const ChaseTagRules& rules, NumpyGenerator& generator) {
  constexpr double kBelow = 0.02;  // m: so deep the lowest point lies
  for (double& sample : drawn_.reshaped<Eigen::RowMajor>()) sample = generator.Uniform(-1, 1);
  drawn_ = Normalised(drawn_);
  drawn_ = drawn_ * generator.Uniform(rules.roughness_m[0], rules.roughness_m[1]) - kBelow;
}

void ChaseTagField::Level(double x, double y, bool mirrored) {
  const HeightGrid map = grid();
  if (mirrored) std::swap(x, y);
  At(map.Row(y) / kPatch, map.Column(x) / kPatch).setZero();
}

HeightGrid ChaseTagField::grid() const {
  constexpr double kPitch = 12.0 / kSamples;
  return {.heights = heights(),
          .rows = kSamples,
          .columns = kSamples,
          .row_pitch = kPitch,
          .column_pitch = kPitch,
          .view = 2};
}

}  // namespace myograde::sim
