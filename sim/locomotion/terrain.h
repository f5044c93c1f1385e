// The course of the locomotion track: a grid of heights that is filled anew
// for each episode, and the questions that are asked of it.
//
// Row r of the grid lies at y = -half_length + 2 half_length r / (rows - 1),
// column c at x = -half_width + 2 half_width c / (columns - 1). The person
// walks towards -y, so from high rows to low ones. Between samples the surface
// is MuJoCo's: each cell is two triangles.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "sim/locomotion/rules.h"
#include "sim/random/numpy.h"

namespace myograde::sim {

class Terrain {
 public:
  // `field` and `course` come from ParseLocomotionRules; `start_y` is where
  // the course's distance begins (used by PatchPlacement::kByDistance).
  Terrain(const FieldRules& field, const CourseRules& course, double start_y);

  // Draws the kind of course and fills the grid. `legacy` is drawn from only
  // with RoughStream::kLegacy.
  void Build(NumpyGenerator& random, LegacyNumpyGenerator& legacy);

  // The kind of course that was drawn.
  CourseKind kind() const { return kind_; }
  // What each patch was filled with, in the order of CourseRules::difficulty;
  // kFlat for level patches.
  std::span<const CourseKind> patches() const { return patches_; }

  int rows() const { return field_.rows; }
  int columns() const { return field_.columns; }
  // Heights in m above the field's zero, row by row, as MuJoCo keeps them:
  // single precision.
  std::span<const float> heights() const {
    return {heights_.data(), static_cast<size_t>(heights_.size())};
  }
  float at(int row, int column) const { return heights_(row, column); }
  double RowY(int row) const;

  // World height in m of the ground at (x, y): the field's surface, or the
  // ground plane (0) outside of the field.
  double GroundAt(double x, double y) const;

  // The height in m of the highest obstacle of this kind that lies wholly behind a person at `y`:
  // of its top above the level ground before it, of stairs of one step. nullopt if there is none.
  std::optional<double> HighestPassed(CourseKind kind, double y) const;

 private:
  struct RowRange {
    int begin = 0;
    int end = 0;
  };

  RowRange PatchRows(int patch) const;
  double ObstacleHeight(CourseKind kind, RowRange rows) const;
  void FillPatch(int patch, CourseKind kind, NumpyGenerator& random,
                 LegacyNumpyGenerator& legacy);
  void FillStairs(RowRange rows, double step);
  void FillHill(int patch, RowRange rows, double height);
  void FillRough(RowRange rows, double range, NumpyGenerator& random,
                 LegacyNumpyGenerator& legacy);
  // Writes samples_ to the rows, min-max normalised and times `scale`.
  void WriteNormalised(RowRange rows, double scale);

  FieldRules field_;
  CourseRules course_;
  double start_y_;
  CourseKind kind_ = CourseKind::kFlat;
  std::vector<CourseKind> patches_;
  std::vector<CourseKind> hand_;  // of a mixed course, kept to allocate once
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> heights_;
  Eigen::ArrayXd samples_;  // of one patch, kept to allocate once
};

}  // namespace myograde::sim
