// NumPy's random streams: against the golden draws and by their properties.
#include "sim/random/numpy.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

std::string Decimal(unsigned __int128 value) {
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
    value /= 10;
  } while (value != 0);
  return digits;
}

void ExpectState(const NumpyGenerator& generator, const nlohmann::json& want,
                 const std::string& where) {
  EXPECT_EQ(Decimal(generator.state()), want.at("state").get<std::string>()) << where;
  EXPECT_EQ(Decimal(generator.increment()), want.at("inc").get<std::string>()) << where;
}

// The recorded order of draws: 8 random(), 20 integers(0, 3), 20 choice(3),
// 4 uniform(-2, 5), then integers(0, 3), uniform(0, 0.24), integers(0, 3),
// uniform(-0.8, 0.8).
void CheckCase(const nlohmann::json& golden, const std::string& where) {
  NumpyGenerator generator(golden.at("seed").get<uint64_t>());
  ExpectState(generator, golden.at("pcg64"), where);
  for (const auto& want : golden.at("random_8")) {
    EXPECT_EQ(generator.Random(), want.get<double>()) << where;
  }
  for (const char* draws : {"integers_0_3_x20", "choice3_x20"}) {
    for (const auto& want : golden.at(draws)) {
      EXPECT_EQ(generator.Integers(3), want.get<uint32_t>()) << where << " " << draws;
    }
  }
  ExpectState(generator, golden.at("after_ints_state"), where);
  for (const auto& want : golden.at("uniform_m2_5_x4")) {
    EXPECT_EQ(generator.Uniform(-2, 5), want.get<double>()) << where;
  }
  std::vector<double> mixed;
  for (const double bound : {0.0, 0.8}) {
    mixed.push_back(generator.Integers(3));
    mixed.push_back(generator.Uniform(-bound, bound == 0 ? 0.24 : bound));
  }
  EXPECT_EQ(mixed, golden.at("mixed").get<std::vector<double>>()) << where;
}

TEST(NumpyGolden, DrawsAreThoseOfNumpy) {
  int checked = 0;
  for (const GoldenFile& file : GoldenFiles()) {
    if (!file.json.contains("legacy_mt19937")) continue;
    for (const auto& golden : file.json.at("cases")) {
      CheckCase(golden, file.name + " seed " + golden.at("seed").dump());
      ++checked;
    }
    for (const auto& golden : file.json.at("legacy_mt19937")) {
      LegacyNumpyGenerator generator(golden.at("seed").get<uint32_t>());
      for (const auto& want : golden.at("uniform_m1_1_8")) {
        EXPECT_EQ(generator.Uniform(-1, 1), want.get<double>()) << file.name;
      }
      ++checked;
    }
  }
  if (checked == 0) GTEST_SKIP() << "no golden file of random draws in the folder";
}

TEST(NumpyGenerator, KeepsTheOtherHalfOfAWord) {
  NumpyGenerator halves(7);
  NumpyGenerator whole(7);
  const uint64_t word = whole.Next64();
  EXPECT_EQ(halves.Next32(), static_cast<uint32_t>(word));
  halves.Next64();  // a 64-bit draw in between does not use the kept half up
  EXPECT_EQ(halves.Next32(), static_cast<uint32_t>(word >> 32));
}

TEST(LegacyNumpyGenerator, MatchesTheReferenceGenerator) {
  // The 10000th output of MT19937 seeded with 5489, as the C++ standard states it.
  LegacyNumpyGenerator generator(5489);
  uint32_t word = 0;
  for (int i = 0; i < 10000; ++i) word = generator.Next32();
  EXPECT_EQ(word, 4123659995u);
}

RC_GTEST_PROP(NumpyGenerator, IntegersStayInTheirRange, (uint64_t seed)) {
  const auto n = *rc::gen::inRange<uint32_t>(1, 0xffffffffu);
  NumpyGenerator generator(seed);
  for (int i = 0; i < 20; ++i) RC_ASSERT(generator.Integers(n) < n);
}

RC_GTEST_PROP(NumpyGenerator, SeedsDecideEverything, (uint64_t seed)) {
  NumpyGenerator one(seed);
  NumpyGenerator same(seed);
  NumpyGenerator other(seed + 1);
  const double draw = one.Random();
  RC_ASSERT(draw == same.Random());
  RC_ASSERT(draw != other.Random());
  RC_ASSERT(draw >= 0 && draw < 1);
}

TEST(NumpyGenerator, IntegersAreUniform) {
  NumpyGenerator generator(3);
  constexpr int kDraws = 30000;
  int counts[3] = {};
  for (int i = 0; i < kDraws; ++i) ++counts[generator.Integers(3)];
  // Chi squared with 2 degrees of freedom: 13.8 is exceeded once in a thousand.
  double chi_squared = 0;
  for (const int count : counts) chi_squared += (count - 1e4) * (count - 1e4) / 1e4;
  EXPECT_LT(chi_squared, 13.8);
}

}  // namespace
}  // namespace myograde::sim
