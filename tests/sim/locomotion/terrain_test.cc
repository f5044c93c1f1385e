#include "sim/locomotion/terrain.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <vector>

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>

#include "sim/locomotion/height_map.h"
#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

// A course of the paper profile with the kinds given.
Terrain PaperCourse(const std::vector<std::string>& kinds, uint64_t seed = 1) {
  nlohmann::json rules = ShippedRules("paper");
  rules["course"]["kinds"] = kinds;
  const LocomotionRules parsed = ParsedRules(rules);
  Terrain terrain(parsed.field, parsed.course, parsed.end.distance_from_y_m);
  NumpyGenerator random(seed);
  LegacyNumpyGenerator legacy(static_cast<uint32_t>(seed));
  terrain.Build(random, legacy);
  return terrain;
}

// Height above the course's level at a distance from the start.
double HeightAt(const Terrain& terrain, double distance, double x = 0.3) {
  return terrain.GroundAt(x, 55 - distance) - 0.005;
}

// Highest and lowest sample with a distance in [from, to].
std::pair<double, double> Extent(const Terrain& terrain, double from, double to) {
  double low = 1e9, high = -1e9;
  for (int row = 0; row < terrain.rows(); ++row) {
    const double distance = 55 - terrain.RowY(row);
    if (distance < from || distance > to) continue;
    for (int column = 0; column < terrain.columns(); ++column) {
      low = std::min(low, double{terrain.at(row, column)});
      high = std::max(high, double{terrain.at(row, column)});
    }
  }
  return {low, high};
}

TEST(PaperCourse, FlatIsLevelEverywhere) {
  const Terrain terrain = PaperCourse({"flat"});
  EXPECT_EQ(terrain.kind(), CourseKind::kFlat);
  EXPECT_EQ(Extent(terrain, -5, 120), std::make_pair(0.0, 0.0));
}

TEST(PaperCourse, IsLevelBetweenObstaclesThatEndAtTens) {
  for (const char* kind : {"hilly", "rough", "stairs", "mixed"}) {
    const Terrain terrain = PaperCourse({kind});
    EXPECT_EQ(Extent(terrain, -5, 25), std::make_pair(0.0, 0.0)) << kind;
    for (int k = 3; k <= 10; ++k) {
      EXPECT_GT(Extent(terrain, 10 * k - 5, 10 * k).second, 0) << kind << " " << k;
      const auto after = Extent(terrain, 10 * k + 1e-9, 10 * k + 5);
      EXPECT_EQ(after, std::make_pair(0.0, 0.0)) << kind << " " << k;
    }
  }
}

TEST(PaperCourse, HillsAreHalfASineThatGrowsTo50Degrees) {
  const Terrain terrain = PaperCourse({"hilly"});
  for (int k = 3; k <= 10; ++k) {
    const double height = 1.5 * (k - 2) / 8;
    // Foot at 0.525 m into the patch, top in its middle; between samples the
    // surface is a chord, at most 1.3 % of the height below the sine.
    EXPECT_NEAR(HeightAt(terrain, 10 * k - 2.5), height, 0.013 * height) << k;
    for (const double along : {0.1, 0.25, 0.4, 0.7, 0.9}) {
      EXPECT_NEAR(HeightAt(terrain, 10 * k - 5 + 0.525 + 3.95 * along),
                  height * std::sin(std::numbers::pi * along), 0.013 * height)
          << k << " " << along;
    }
    EXPECT_EQ(HeightAt(terrain, 10 * k - 4.8), 0) << k;
    EXPECT_EQ(HeightAt(terrain, 10 * k - 0.2), 0) << k;
  }
  const double steepest = std::atan(1.5 * std::numbers::pi / 3.95) * 180 / std::numbers::pi;
  EXPECT_NEAR(steepest, 50, 0.1);
  // Each sample is exact, the same over the whole width.
  for (int row = 0; row < terrain.rows(); ++row) {
    const double distance = 55 - terrain.RowY(row);
    const double along = (distance - 95 - 0.525) / 3.95;
    if (along <= 0 || along >= 1) continue;
    for (int column = 0; column < terrain.columns(); ++column) {
      EXPECT_FLOAT_EQ(terrain.at(row, column),
                      static_cast<float>(1.5 * std::sin(std::numbers::pi * along)));
    }
  }
}

TEST(PaperCourse, StairsGoThreeUpAndThreeDown) {
  const Terrain terrain = PaperCourse({"stairs"});
  for (int k = 3; k <= 10; ++k) {
    const double step = 0.5 * (k - 2) / 8;
    std::vector<double> walked = {0};  // heights in walking order, each once
    for (int row = terrain.rows() - 1; row >= 0; --row) {
      const double distance = 55 - terrain.RowY(row);
      if (distance < 10 * k - 6 || distance > 10 * k + 1) continue;
      const double height = terrain.at(row, 7);
      if (height != walked.back()) walked.push_back(height);
    }
    ASSERT_EQ(walked.size(), 7u) << k;
    const double expected[] = {0, 1, 2, 3, 2, 1, 0};
    for (int i = 0; i < 7; ++i) EXPECT_NEAR(walked[i], expected[i] * step, 1e-6) << k << " " << i;
  }
  EXPECT_NEAR(Extent(terrain, 95, 100).second, 1.5, 1e-6);
}

TEST(PaperCourse, RoughPatchesHaveTheirFullRange) {
  const Terrain terrain = PaperCourse({"rough"});
  for (int k = 3; k <= 10; ++k) {
    const auto [low, high] = Extent(terrain, 10 * k - 5, 10 * k);
    EXPECT_EQ(low, 0) << k;
    EXPECT_NEAR(high, 0.6 * (k - 2) / 8, 1e-6) << k;
  }
}

TEST(HighestPassed, GrowsFromObstacleToObstacleOfItsKind) {
  const struct {
    const char* name;
    CourseKind kind;
    double largest;
  } kinds[] = {{"hilly", CourseKind::kHilly, 1.5},
               {"rough", CourseKind::kRough, 0.6},
               {"stairs", CourseKind::kStairs, 0.5}};
  for (const auto& [name, kind, largest] : kinds) {
    const Terrain terrain = PaperCourse({name});
    for (int k = 3; k <= 10; ++k) {
      const auto before = terrain.HighestPassed(kind, 55 - (10 * k - 0.3));
      const auto after = terrain.HighestPassed(kind, 55 - (10 * k + 0.05));
      if (k == 3) {
        EXPECT_EQ(before, std::nullopt) << name;
      } else {
        EXPECT_NEAR(before.value(), largest * (k - 3) / 8, 0.013 * largest) << name << " " << k;
      }
      // Of a hill the highest sample may miss the top by a little.
      EXPECT_NEAR(after.value(), largest * (k - 2) / 8, 0.003 * largest) << name << " " << k;
    }
    for (const auto& [other, other_kind, other_largest] : kinds) {
      EXPECT_EQ(terrain.HighestPassed(other_kind, -50).has_value(), other_kind == kind) << other;
    }
  }
  EXPECT_EQ(PaperCourse({"flat"}).HighestPassed(CourseKind::kFlat, 55), std::nullopt);
}

TEST(HighestPassed, OfAMixedCourseIsOfEachKind) {
  const Terrain terrain = PaperCourse({"mixed"});
  for (const CourseKind kind : {CourseKind::kHilly, CourseKind::kRough, CourseKind::kStairs}) {
    EXPECT_GT(terrain.HighestPassed(kind, -46).value(), 0);
  }
}

TEST(PaperCourse, RoughHeightsAreUniformAndDifferWithTheSeed) {
  std::vector<double> heights;
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const Terrain terrain = PaperCourse({"rough"}, seed);
    for (int row = 0; row < terrain.rows(); ++row) {
      const double distance = 55 - terrain.RowY(row);
      if (distance <= 95 || distance > 100) continue;
      for (int column = 0; column < 30; ++column) heights.push_back(terrain.at(row, column) / 0.6);
    }
  }
  std::sort(heights.begin(), heights.end());
  double farthest = 0;  // Kolmogorov-Smirnov: 1.95 / sqrt(n) is the 0.1 % point
  const double n = static_cast<double>(heights.size());
  for (size_t i = 0; i < heights.size(); ++i) {
    farthest = std::max(farthest, std::abs(heights[i] - static_cast<double>(i) / n));
  }
  EXPECT_GT(n, 7000);
  EXPECT_LT(farthest, 1.95 / std::sqrt(n));
  const Terrain one = PaperCourse({"rough"}, 1), two = PaperCourse({"rough"}, 2);
  EXPECT_FALSE(std::ranges::equal(one.heights(), two.heights()));
}

TEST(PaperCourse, MixedDrawsEachObstacle) {
  std::map<CourseKind, int> counts;
  for (uint64_t seed = 0; seed < 300; ++seed) {
    const Terrain terrain = PaperCourse({"mixed"}, seed);
    EXPECT_EQ(terrain.kind(), CourseKind::kMixed);
    for (size_t i = 0; i < terrain.patches().size(); ++i) {
      const CourseKind kind = terrain.patches()[i];
      EXPECT_EQ(kind == CourseKind::kFlat, i < 5 || i % 2 == 0) << i;
      if (kind != CourseKind::kFlat) ++counts[kind];
    }
  }
  ASSERT_EQ(counts.size(), 3u);
  double chi = 0;
  for (const auto& [kind, count] : counts) chi += (count - 800.0) * (count - 800.0) / 800;
  EXPECT_LT(chi, 13.8);  // 0.1 % point of two degrees of freedom
}

TEST(PaperCourse, MixedHoldsEveryKindAtLeastTwice) {
  std::set<std::vector<CourseKind>> orders;
  std::set<std::multiset<CourseKind>> hands;
  for (uint64_t seed = 0; seed < 300; ++seed) {
    std::vector<CourseKind> obstacles;
    const Terrain terrain = PaperCourse({"mixed"}, seed);
    for (const CourseKind kind : terrain.patches()) {
      if (kind != CourseKind::kFlat) obstacles.push_back(kind);
    }
    ASSERT_EQ(obstacles.size(), 8u);
    for (const CourseKind kind : {CourseKind::kHilly, CourseKind::kRough, CourseKind::kStairs}) {
      EXPECT_GE(std::count(obstacles.begin(), obstacles.end(), kind), 2) << seed;
    }
    orders.insert(obstacles);
    hands.insert({obstacles.begin(), obstacles.end()});
  }
  EXPECT_EQ(hands.size(), 6u);  // all ways to add two of three kinds
  EXPECT_GT(orders.size(), 250u);
}

TEST(OfficialCourse, MixedDrawsEachPatchByItself) {
  const LocomotionRules rules = OfficialRules("Random", "random_mixed");
  bool one_was_missing = false;
  for (uint64_t seed = 0; seed < 300; ++seed) {
    Terrain terrain(rules.field, rules.course, rules.end.distance_from_y_m);
    NumpyGenerator random(seed);
    LegacyNumpyGenerator legacy(static_cast<uint32_t>(seed));
    terrain.Build(random, legacy);
    const std::set<CourseKind> kinds(terrain.patches().begin(), terrain.patches().end());
    one_was_missing = one_was_missing || kinds.size() < 4;  // level patches are flat
  }
  EXPECT_TRUE(one_was_missing);
}

TEST(PaperCourse, KindOfCourseIsUniformOverFive) {
  const LocomotionRules rules = ParsedRules(ShippedRules("paper"));
  std::map<CourseKind, int> counts;
  for (uint64_t seed = 0; seed < 1000; ++seed) {
    Terrain terrain(rules.field, rules.course, rules.end.distance_from_y_m);
    NumpyGenerator random(seed);
    LegacyNumpyGenerator legacy(static_cast<uint32_t>(seed));
    terrain.Build(random, legacy);
    ++counts[terrain.kind()];
  }
  ASSERT_EQ(counts.size(), 5u);
  double chi = 0;
  for (const auto& [kind, count] : counts) chi += (count - 200.0) * (count - 200.0) / 200;
  EXPECT_LT(chi, 18.5);  // 0.1 % point of four degrees of freedom
}

TEST(OfficialCourse, NeverIsFlatOrMixedAndScalesRoughness) {
  const LocomotionRules rules = OfficialRules("Random");
  std::set<CourseKind> kinds;
  std::vector<double> roughness;
  for (uint64_t seed = 0; seed < 200; ++seed) {
    Terrain terrain(rules.field, rules.course, rules.end.distance_from_y_m);
    NumpyGenerator random(seed);
    LegacyNumpyGenerator legacy(static_cast<uint32_t>(seed));
    terrain.Build(random, legacy);
    kinds.insert(terrain.kind());
    if (terrain.kind() != CourseKind::kRough) continue;
    float high = 0;  // of the hardest patch, rows 100 to 124
    for (int i = 100 * 20; i < 125 * 20; ++i) high = std::max(high, terrain.heights()[i]);
    roughness.push_back(high);
  }
  EXPECT_EQ(kinds, (std::set{CourseKind::kHilly, CourseKind::kRough, CourseKind::kStairs}));
  double mean = 0;
  for (const double value : roughness) {
    EXPECT_LE(value, 0.24 + 1e-7);
    mean += value / static_cast<double>(roughness.size());
  }
  // Uniform from 0 to 0.24: five standard errors of its mean.
  const double error = 0.24 / std::sqrt(12.0 * static_cast<double>(roughness.size()));
  EXPECT_NEAR(mean, 0.12, 5 * error);
}

TEST(Ground, IsTheSurfaceThatMujocoHas) {
  nlohmann::json json = ShippedRules("paper");
  json["course"]["kinds"] = {"rough"};
  auto environment = MakeEnvironment(ParsedRules(json));
  environment->Reset(3);
  mjData& data = environment->data();
  const LocomotionIndices& at = environment->indices();
  NumpyGenerator random(5);
  for (int i = 0; i < 2000; ++i) {
    const double x = random.Uniform(-1.49, 1.49);
    const double y = random.Uniform(-45, 30);
    const mjtNum from[3] = {x, y, 1.9};
    const mjtNum down[3] = {0, 0, -1};
    const double depth = mj_rayHfield(&environment->model(), &data, at.field_geom, from, down);
    ASSERT_GE(depth, 0);
    EXPECT_NEAR(environment->terrain().GroundAt(x, y), 1.9 - depth, 1e-6) << x << " " << y;
  }
}

TEST(Ground, IsThePlaneOutsideOfTheField) {
  const Terrain terrain = PaperCourse({"hilly"});
  EXPECT_EQ(terrain.GroundAt(1.51, 0), 0);
  EXPECT_EQ(terrain.GroundAt(-1.51, 0), 0);
  EXPECT_EQ(terrain.GroundAt(0, 60.01), 0);
  EXPECT_EQ(terrain.GroundAt(std::nan(""), 0), 0);
  EXPECT_DOUBLE_EQ(terrain.GroundAt(0, 50), 0.005);
  EXPECT_DOUBLE_EQ(terrain.GroundAt(1.5, 60), 0.005);
}

TEST(HeadingMap, LooksAheadAndLeftAndIsRelative) {
  const Terrain terrain = PaperCourse({"hilly"});
  const auto map = [&](double x, double y, double yaw) {
    const double q[4] = {std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)};
    std::vector<double> out(100);
    HeadingHeightMap(terrain, {{x, y}, q}, 0.2, out);
    return out;
  };
  // Facing the last hill (-y) from 0.2 m before its foot: ahead is uphill.
  const double y = 55 - 95.3;
  const double down = -std::numbers::pi / 2;
  auto heights = map(0, y, down);
  for (int i = 0; i < 10; ++i) {
    const double ahead = 0.9 - 0.2 * i;
    for (int j = 0; j < 10; ++j) {
      const double left = 0.9 - 0.2 * j;
      // Facing -y, left is +x.
      EXPECT_NEAR(heights[10 * i + j], terrain.GroundAt(left, y - ahead) - 0.005, 1e-9);
    }
  }
  EXPECT_GT(heights[0], 0.5);
  EXPECT_EQ(heights[99], 0);
  // Turned about, the hill is behind.
  heights = map(0, y, -down);
  EXPECT_EQ(heights[0], 0);
  EXPECT_GT(heights[99], 0.5);
  // On the top everything is lower.
  for (const double height : map(0, 55 - 97.5, 0.3)) EXPECT_LE(height, 0.02);
  // Beyond the field's side there is the plane, 5 mm below.
  heights = map(1.2, 45, down);
  EXPECT_DOUBLE_EQ(heights[0], -0.005);
  EXPECT_DOUBLE_EQ(heights[9], 0);
}

TEST(HeadingMap, DoesNotTurnWithLeaning) {
  const Terrain terrain = PaperCourse({"rough"});
  // The same heading (rotation about z), upright and leaning 0.4 rad ahead.
  const double yaw = -1.2, lean = 0.4;
  const double upright[4] = {std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)};
  const double tilt[4] = {std::cos(lean / 2), 0, std::sin(lean / 2), 0};
  double leaning[4];
  mju_mulQuat(leaning, upright, tilt);
  std::vector<double> one(100), two(100);
  HeadingHeightMap(terrain, {{0.1, -42}, upright}, 0.2, one);
  HeadingHeightMap(terrain, {{0.1, -42}, leaning}, 0.2, two);
  for (int i = 0; i < 100; ++i) EXPECT_NEAR(one[i], two[i], 1e-9);
}

}  // namespace
}  // namespace myograde::sim
