// Each random quantity of a reset differs with the seed and has the documented
// distribution. Seeds are fixed, so these tests can't fail by chance; bounds
// are the 0.1 % points.
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "tests/sim/locomotion/fixture.h"

namespace myograde::sim {
namespace {

constexpr int kSeeds = 400;

struct Draw {
  double x, y, heading_deg, speed, lowest_foot;
  double knee;  // tells the keyframes apart
  LegState leg_state;
  CourseKind course;
};

Draw DrawOf(LocomotionEnvironment& environment) {
  const mjData& data = environment.data();
  const LocomotionIndices& at = environment.indices();
  const double* q = data.qpos + 3;
  Draw draw{};
  draw.x = data.qpos[0];
  draw.y = data.qpos[1];
  draw.heading_deg = std::atan2(2 * (q[0] * q[3] + q[1] * q[2]),
                                1 - 2 * (q[2] * q[2] + q[3] * q[3])) *
                     180 / std::numbers::pi;
  draw.speed = std::hypot(data.qvel[0], data.qvel[1]);
  draw.lowest_foot = 1e9;
  for (const int site : at.foot_sites) {
    draw.lowest_foot = std::min(draw.lowest_foot, data.site_xpos[3 * site + 2]);
  }
  draw.knee = data.qpos[at.knee_qpos];
  draw.leg_state = environment.leg().state();
  draw.course = environment.terrain().kind();
  return draw;
}

std::vector<Draw> Draws(const std::string& profile) {
  auto environment = MakeEnvironment(ParsedRules(ShippedRules(profile)));
  std::vector<Draw> draws;
  for (uint64_t seed = 1000; seed < 1000 + kSeeds; ++seed) {
    environment->Reset(seed);
    draws.push_back(DrawOf(*environment));
  }
  return draws;
}

void ExpectUniform(std::vector<double> values, double low, double high, const std::string& what) {
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  EXPECT_GE(values.front(), low) << what;
  EXPECT_LE(values.back(), high) << what;
  EXPECT_EQ(std::set<double>(values.begin(), values.end()).size(), values.size()) << what;
  double farthest = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const double expected = (values[i] - low) / (high - low);
    farthest = std::max({farthest, std::abs(expected - static_cast<double>(i) / n),
                         std::abs(expected - static_cast<double>(i + 1) / n)});
  }
  EXPECT_LT(farthest, 1.95 / std::sqrt(n)) << what;  // Kolmogorov and Smirnov
}

void ExpectEqualShares(const std::map<double, int>& counts, size_t kinds, double bound,
                       const std::string& what) {
  ASSERT_EQ(counts.size(), kinds) << what;
  const double expected = static_cast<double>(kSeeds) / static_cast<double>(kinds);
  double chi = 0;
  for (const auto& [value, count] : counts) chi += std::pow(count - expected, 2) / expected;
  EXPECT_LT(chi, bound) << what;
}

void CheckProfile(const std::string& profile, double y, double heading_low, size_t courses,
                  double courses_bound) {
  std::vector<double> xs, headings;
  std::map<double, int> postures, kinds;
  for (const Draw& draw : Draws(profile)) {
    xs.push_back(draw.x);
    headings.push_back(draw.heading_deg);
    ++postures[std::round(draw.knee * 1e6)];
    ++kinds[static_cast<double>(draw.course)];
    EXPECT_EQ(draw.y, y);
    EXPECT_NEAR(draw.lowest_foot, 0.005, 1e-12);
    const bool moving = draw.knee > 1e-9;
    EXPECT_NEAR(draw.speed, moving ? 1.2 : 0, 1e-12);
    // The leg swings in the one posture in which it is behind.
    EXPECT_EQ(draw.leg_state == LegState::kEarlySwing, std::abs(draw.knee - 0.377) < 1e-9);
  }
  ExpectUniform(xs, -0.8, 0.8, profile + " x");
  ExpectUniform(headings, heading_low - 1e-9, -60 + 1e-9, profile + " heading");
  ExpectEqualShares(postures, 3, 13.8, profile + " posture");
  ExpectEqualShares(kinds, courses, courses_bound, profile + " course");
}

TEST(LocomotionDraws, PaperHasItsDistributions) { CheckProfile("paper", 55, -120, 5, 18.5); }

TEST(LocomotionDraws, MyosuiteHasItsDistributions) { CheckProfile("myosuite", 59, -125, 3, 13.8); }

TEST(LocomotionDraws, TheUpperHalfOfTheSeedCounts) {
  const LocomotionRules rules = OfficialRules("Random");
  auto environment = MakeEnvironment(rules);
  const uint64_t high = uint64_t{7} << 32;
  environment->Reset(high + 3);
  const double x = environment->data().qpos[0];
  environment->Reset(3);
  EXPECT_NE(environment->data().qpos[0], x);
}

}  // namespace
}  // namespace myograde::sim
