#include "sim/locomotion/terrain.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace myograde::sim {
namespace {

// Stairs are six treads, in steps above the level: three up, three down. The
// first is the far one; rows that are left over at the near end stay level.
constexpr int kTreads = 6;
constexpr int kTreadSteps[kTreads] = {0, 1, 1, 1, -1, -1};

CourseKind Draw(std::span<const CourseKind> kinds, NumpyGenerator& random) {
  if (kinds.size() == 1) return kinds[0];
  return kinds[random.Integers(static_cast<uint32_t>(kinds.size()))];
}

// The obstacles of a mixed course in the order of its patches: every kind as often as it must
// be there, the rest drawn uniformly, then shuffled.
void DealHand(const CourseRules& course, NumpyGenerator& random, std::vector<CourseKind>& hand) {
  const auto cards = std::ssize(course.difficulty) -
                     std::count(course.difficulty.begin(), course.difficulty.end(), 0);
  hand.clear();
  for (const CourseKind kind : course.mixed_kinds) {
    hand.insert(hand.end(), static_cast<size_t>(course.mixed_at_least), kind);
  }
  while (std::ssize(hand) < cards) hand.push_back(Draw(course.mixed_kinds, random));
  for (size_t left = hand.size(); left > 1; --left) {
    std::swap(hand[left - 1], hand[random.Integers(static_cast<uint32_t>(left))]);
  }
}

}  // namespace

Terrain::Terrain(const FieldRules& field, const CourseRules& course, double start_y)
    : field_(field),
      course_(course),
      start_y_(start_y),
      patches_(course.difficulty.size(), CourseKind::kFlat),
      heights_(decltype(heights_)::Zero(field.rows, field.columns)),
      samples_(heights_.size()) {}

double Terrain::RowY(int row) const {
  return -field_.half_length_m + 2 * field_.half_length_m * row / (field_.rows - 1);
}

void Terrain::Build(NumpyGenerator& random, LegacyNumpyGenerator& legacy) {
  heights_.setZero();
  std::fill(patches_.begin(), patches_.end(), CourseKind::kFlat);
  kind_ = Draw(course_.kinds, random);
  if (kind_ == CourseKind::kFlat) return;
  const bool dealt = kind_ == CourseKind::kMixed && course_.mixed_at_least > 0;
  if (dealt) DealHand(course_, random, hand_);
  size_t next = 0;
  for (size_t i = 0; i < patches_.size(); ++i) {
    const bool level = course_.difficulty[i] == 0;
    if (level && !course_.draw_level_patches) continue;
    CourseKind kind = kind_;
    if (kind_ == CourseKind::kMixed) {
      kind = dealt ? hand_[next++] : Draw(course_.mixed_kinds, random);
    }
    FillPatch(static_cast<int>(i), kind, random, legacy);
    patches_[i] = level ? CourseKind::kFlat : kind;
  }
}

Terrain::RowRange Terrain::PatchRows(int patch) const {
  if (course_.placement == PatchPlacement::kByRow) {
    return {patch * course_.patch_rows, (patch + 1) * course_.patch_rows};
  }
  // The patch reaches from patch * patch_m to (patch + 1) * patch_m of
  // distance; far end included, near end not.
  const double near_y = start_y_ - patch * course_.patch_m;
  const double far_y = start_y_ - (patch + 1) * course_.patch_m;
  RowRange rows;
  while (rows.begin < field_.rows && RowY(rows.begin) < far_y) ++rows.begin;
  rows.end = rows.begin;
  while (rows.end < field_.rows && RowY(rows.end) < near_y) ++rows.end;
  return rows;
}

void Terrain::FillPatch(int patch, CourseKind kind, NumpyGenerator& random,
                        LegacyNumpyGenerator& legacy) {
  const RowRange rows = PatchRows(patch);
  if (rows.begin == rows.end) return;
  const double difficulty = course_.difficulty[patch];
  switch (kind) {
    case CourseKind::kStairs:
      return FillStairs(rows, difficulty * course_.step_m);
    case CourseKind::kHilly:
      return FillHill(patch, rows, difficulty * course_.hill_m);
    case CourseKind::kRough:
      return FillRough(rows, difficulty * course_.roughness_m, random, legacy);
    case CourseKind::kFlat:
    case CourseKind::kMixed:
      return;
  }
}

void Terrain::FillStairs(RowRange rows, double step) {
  const int tread_rows = (rows.end - rows.begin) / kTreads;
  double height = 0;
  int row = rows.begin;
  for (const int up : kTreadSteps) {
    height += up * step;
    heights_.middleRows(row, tread_rows).setConstant(static_cast<float>(height));
    row += tread_rows;
  }
}

void Terrain::FillHill(int patch, RowRange rows, double height) {
  if (course_.hill_shape == HillShape::kMiddle) {
    // Distance into the hill, from its near foot.
    const double foot_y = start_y_ - patch * course_.patch_m -
                          (course_.patch_m - course_.hill_length_m) / 2;
    for (int row = rows.begin; row < rows.end; ++row) {
      const double along = (foot_y - RowY(row)) / course_.hill_length_m;
      if (along <= 0 || along >= 1) continue;
      heights_.row(row).setConstant(
          static_cast<float>(height * std::sin(std::numbers::pi * along)));
    }
    return;
  }
  // numpy.linspace(0, pi, n), backwards: multiples of one step, the last value exact.
  const int n = (rows.end - rows.begin) * field_.columns;
  const double step = std::numbers::pi / (n - 1);
  for (int i = 0; i < n; ++i) {
    samples_[n - 1 - i] = std::sin(i == n - 1 ? std::numbers::pi : i * step);
  }
  WriteNormalised(rows, height);
}

void Terrain::FillRough(RowRange rows, double range, NumpyGenerator& random,
                        LegacyNumpyGenerator& legacy) {
  const int n = (rows.end - rows.begin) * field_.columns;
  for (int i = 0; i < n; ++i) {
    samples_[i] = course_.rough_stream == RoughStream::kLegacy ? legacy.Uniform(-1, 1)
                                                               : random.Uniform(-1, 1);
  }
  const double scale = course_.rough_random_scale ? random.Uniform(0, range) : range;
  WriteNormalised(rows, scale);
}

void Terrain::WriteNormalised(RowRange rows, double scale) {
  const int n = (rows.end - rows.begin) * field_.columns;
  const auto samples = samples_.head(n);
  const double low = samples.minCoeff();
  Eigen::ArrayXf::Map(heights_.row(rows.begin).data(), n) =
      ((samples - low) / (samples.maxCoeff() - low) * scale).cast<float>();
}

double Terrain::ObstacleHeight(CourseKind kind, RowRange rows) const {
  const auto heights = heights_.middleRows(rows.begin, rows.end - rows.begin);
  // Every obstacle is built up from the level of the course.
  if (kind != CourseKind::kStairs || heights.rows() < 2) return heights.maxCoeff();
  const auto rises = heights.bottomRows(heights.rows() - 1) - heights.topRows(heights.rows() - 1);
  return rises.maxCoeff();
}

std::optional<double> Terrain::HighestPassed(CourseKind kind, double y) const {
  std::optional<double> highest;
  for (size_t i = 0; i < patches_.size(); ++i) {
    if (patches_[i] != kind) continue;
    const RowRange rows = PatchRows(static_cast<int>(i));
    if (rows.begin == rows.end || y >= RowY(rows.begin)) continue;
    highest = std::max(highest.value_or(0), ObstacleHeight(kind, rows));
  }
  return highest;
}

double Terrain::GroundAt(double x, double y) const {
  const double column = (x / field_.half_width_m + 1) * 0.5 * (field_.columns - 1);
  const double row = (y / field_.half_length_m + 1) * 0.5 * (field_.rows - 1);
  // Written so that NaN counts as outside.
  if (!(column >= 0 && column <= field_.columns - 1 && row >= 0 && row <= field_.rows - 1)) {
    return 0;
  }
  const int c = std::min(static_cast<int>(column), field_.columns - 2);
  const int r = std::min(static_cast<int>(row), field_.rows - 2);
  const double u = column - c;  // along x in the cell
  const double v = row - r;     // along y in the cell
  const double low = at(r, c), right = at(r, c + 1), up = at(r + 1, c), high = at(r + 1, c + 1);
  // MuJoCo cuts a cell from its lowest to its highest indices.
  const double height = v >= u ? low + v * (up - low) + u * (high - up)
                               : low + u * (right - low) + v * (high - right);
  return field_.offset_m + height;
}

}  // namespace myograde::sim
