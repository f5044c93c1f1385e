// What is drawn for an episode: its distribution, its dependence on the seed,
// and what it does to the model.
#include "sim/manipulation/variation.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "tests/sim/manipulation/helpers.h"

namespace myograde::sim {
namespace {

struct Quantity {
  std::function<double(const Variation&)> value;
  double low, high;
};

// Every drawn number of a profile with the documented range.
std::map<std::string, Quantity> Quantities(const ManipulationRules& rules) {
  std::map<std::string, Quantity> all;
  const auto add = [&](const std::string& name, double centre, double spread, auto value) {
    all[name] = {value, centre - spread, centre + spread};
  };
  for (int i = 0; i < 3; ++i) {
    const std::string axis = std::to_string(i);
    if (rules.start_spread_m[i] > 0) {
      add("start " + axis, rules.start_centre_m[i], rules.start_spread_m[i],
          [i](const Variation& v) { return v.start[i]; });
      add("goal " + axis, rules.goal_centre_m[i], rules.goal_spread_m[i],
          [i](const Variation& v) { return v.goal[i]; });
    }
    add("friction " + axis, rules.friction[i], rules.friction_spread[i],
        [i](const Variation& v) { return v.friction[i]; });
    add("size " + axis, rules.half_size_m[i], rules.half_size_m[i] * rules.size_spread[i],
        [i](const Variation& v) { return v.half_size[i]; });
  }
  add("mass", rules.mass_kg, rules.mass_spread_kg, [](const Variation& v) { return v.mass; });
  return all;
}

Variation Draw(const ManipulationRules& rules, uint64_t seed) {
  NumpyGenerator generator(seed);
  return DrawVariation(rules, true, generator);
}

TEST(Variation, EachQuantityIsUniformInItsDocumentedRange) {
  constexpr int kSeeds = 4000;
  for (const char* profile : {"paper", "as-graded"}) {
    const ManipulationRules rules = RulesOf(profile);
    const auto quantities = Quantities(rules);
    EXPECT_EQ(quantities.size(), 11u);
    std::map<std::string, std::vector<double>> samples;
    for (uint64_t seed = 0; seed < kSeeds; ++seed) {
      const Variation variation = Draw(rules, seed);
      for (const auto& [name, quantity] : quantities) {
        const double place =
            (quantity.value(variation) - quantity.low) / (quantity.high - quantity.low);
        ASSERT_GE(place, -1e-12) << name;
        ASSERT_LE(place, 1 + 1e-12) << name;
        samples[name].push_back(place);
      }
    }
    // Kolmogorov and Smirnov's distance; above 1.95 / sqrt(n) once in a thousand.
    // The seeds are fixed, so the test always gives the same answer.
    for (auto& [name, sample] : samples) {
      std::ranges::sort(sample);
      double distance = 0;
      for (size_t i = 0; i < sample.size(); ++i) {
        const double expected = (static_cast<double>(i) + 0.5) / kSeeds;
        distance = std::max(distance, std::abs(sample[i] - expected));
      }
      EXPECT_LT(distance, 1.95 / std::sqrt(kSeeds)) << profile << " " << name;
    }
  }
}

TEST(Variation, OtherSeedsGiveOtherValues) {
  const ManipulationRules rules = RulesOf("paper");
  for (const auto& [name, quantity] : Quantities(rules)) {
    std::set<double> values;
    for (uint64_t seed = 0; seed < 50; ++seed) values.insert(quantity.value(Draw(rules, seed)));
    EXPECT_EQ(values.size(), 50u) << name;
  }
}

TEST(Variation, QuantitiesDoNotFollowEachOther) {
  const ManipulationRules rules = RulesOf("paper");
  const auto quantities = Quantities(rules);
  constexpr int kSeeds = 2000;
  for (auto a = quantities.begin(); a != quantities.end(); ++a) {
    for (auto b = std::next(a); b != quantities.end(); ++b) {
      double sum = 0;
      for (uint64_t seed = 0; seed < kSeeds; ++seed) {
        const Variation v = Draw(rules, seed);
        const auto centred = [&](const Quantity& q) {
          return 2 * (q.value(v) - q.low) / (q.high - q.low) - 1;
        };
        sum += 3 * centred(a->second) * centred(b->second);
      }
      // Correlation: standard deviation 1 / sqrt(n), 66 pairs.
      EXPECT_LT(std::abs(sum / kSeeds), 4.5 / std::sqrt(kSeeds)) << a->first << ", " << b->first;
    }
  }
}

TEST(Variation, ASizeThatIsNotDrawnTakesNoNumbers) {
  const ManipulationRules rules = RulesOf("myosuite");
  NumpyGenerator with(3);
  NumpyGenerator without(3);
  const Variation drawn = DrawVariation(rules, true, with);
  const Variation nominal = DrawVariation(rules, false, without);
  EXPECT_EQ(nominal.half_size, rules.half_size_m);
  EXPECT_NE(drawn.half_size, rules.half_size_m);
  EXPECT_EQ(drawn.friction, nominal.friction);
  for (int i = 0; i < 3; ++i) without.Next64();
  EXPECT_TRUE(with.state() == without.state());
}

TEST(Variation, PaperMakesTheObjectASolidBox) {
  const auto env = MakeProfile("paper");
  env->Reset(1);
  const Variation& drawn = env->variation();
  const Scene& scene = env->scene();
  const mjModel& m = env->model();
  const auto& h = drawn.half_size;
  const mjtNum* inertia = m.body_inertia + 3 * scene.object_body;
  // A box of edges 2h: mass / 12 times the sum of the squares of the other two edges.
  EXPECT_NEAR(inertia[0], drawn.mass / 12 * 4 * (h[1] * h[1] + h[2] * h[2]), 1e-18);
  EXPECT_NEAR(inertia[1], drawn.mass / 12 * 4 * (h[0] * h[0] + h[2] * h[2]), 1e-18);
  EXPECT_NEAR(inertia[2], drawn.mass / 12 * 4 * (h[0] * h[0] + h[1] * h[1]), 1e-18);
  EXPECT_EQ(m.body_mass[scene.object_body], drawn.mass);
  EXPECT_DOUBLE_EQ(m.geom_rbound[scene.object_box], std::hypot(h[0], h[1], h[2]));
  // The weight that contacts see follows: for a free body, one over its mass.
  EXPECT_NEAR(m.body_invweight0[2 * scene.object_body] * drawn.mass, 1, 1e-9);
}

TEST(Variation, OfficialProfilesLeaveInertiaAndRadiusAlone) {
  const auto env = MakeProfile("as-graded");
  const Scene& scene = env->scene();
  const std::vector<double> inertia(env->model().body_inertia + 3 * scene.object_body,
                                    env->model().body_inertia + 3 * scene.object_body + 3);
  const double radius = env->model().geom_rbound[scene.object_box];
  env->Reset(1);
  env->Reset(1);
  EXPECT_NE(env->variation().half_size, env->rules().half_size_m);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(env->model().body_inertia[3 * scene.object_body + i], inertia[i]);
  }
  EXPECT_EQ(env->model().geom_rbound[scene.object_box], radius);
}

}  // namespace
}  // namespace myograde::sim
