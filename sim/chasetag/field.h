// The field of chase-tag: 12 m by 12 m of 3 x 3 patches, drawn per episode.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string_view>

#include "sim/chasetag/rules.h"
#include "sim/model/height_map.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

class ChaseTagField {
 public:
  static constexpr int kSamples = 100;  // along each side; row r at y = -6 m + 12 m r / 99
  static constexpr int kPatches = 3;    // along each side
  // The last row and column are in no patch: they stay level.
  static constexpr int kPatch = kSamples / kPatches;  // samples along a patch's side

  // `relief`: the bytes of the relief, row by row.
  explicit ChaseTagField(std::string_view relief);

  // Fills all patches, in the official order of draws: rows (y) first.
  void Draw(const ChaseTagRules& rules, NumpyGenerator& generator);

  // Levels the patch around (x, y). `mirrored`: that on the other side of the diagonal x = y, which
  // the official code levels.
  void Level(double x, double y, bool mirrored);

  std::span<const float> heights() const {
    return {heights_.data(), static_cast<size_t>(heights_.size())};
  }
  // As official observations look it up.
  HeightGrid grid() const;

 private:
  using Patch = Eigen::Array<double, kPatch, kPatch, Eigen::RowMajor>;

  auto At(int row, int column) {
    return heights_.block<kPatch, kPatch>(row * kPatch, column * kPatch);
  }
  void DrawHills(const ChaseTagRules& rules, NumpyGenerator& generator);
  void DrawRoughness(const ChaseTagRules& rules, NumpyGenerator& generator);

  Patch hills_;                                                       // of height 1
  Patch relief_;                                                      // of height 1
  Patch drawn_;                                                       // the patch being drawn
  Eigen::Array<float, kSamples, kSamples, Eigen::RowMajor> heights_;  // m
};

}  // namespace myograde::sim
