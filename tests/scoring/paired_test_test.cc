#include "scoring/paired_test.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "protocol/base/config_reader.h"

namespace myograde::scoring {
namespace {

using nlohmann::json;
using Method = PairedTest::Method;

constexpr int64_t kSamples = 10'000;

// SciPy's values; tests/golden/statistics/record.py recorded them.
const json& Golden() {
  static const json golden =
      *ReadJsonFile(MYOGRADE_SOURCE_DIR "/tests/golden/statistics/paired_test.json");
  return golden;
}

std::vector<Pair> MakePairs(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<Pair> pairs;
  for (size_t i = 0; i < a.size(); ++i) pairs.push_back({{a[i]}, {b.at(i)}});
  return pairs;
}

std::vector<Pair> MakePairs(const json& row) {
  return MakePairs(row.at("a").get<std::vector<double>>(), row.at("b").get<std::vector<double>>());
}

std::vector<Pair> Successes(int64_t only_a, int64_t only_b, int64_t both) {
  std::vector<Pair> pairs(static_cast<size_t>(both), Pair{{1}, {1}});
  pairs.insert(pairs.end(), static_cast<size_t>(only_a), Pair{{1}, {0}});
  pairs.insert(pairs.end(), static_cast<size_t>(only_b), Pair{{0}, {1}});
  return pairs;
}

std::vector<Pair> Exchanged(std::vector<Pair> pairs) {
  for (Pair& pair : pairs) std::swap(pair.a, pair.b);
  return pairs;
}

TEST(PairedTest, OfSuccessesIsSciPysBinomialTest) {
  for (const json& row : Golden().at("binomial")) {
    const int64_t n = row.at("differing");
    const int64_t ahead = row.at("ahead");
    SCOPED_TRACE(row.dump());
    const PairedTest test = TestPairs(Successes(ahead, n - ahead, 60), kSamples);
    EXPECT_NEAR(test.p / row.at("p").get<double>(), 1, 1e-11);
    EXPECT_EQ(test.method, Method::kExact);
    EXPECT_EQ(test.differing, n);
    EXPECT_EQ(test.pairs, n + 60);
  }
}

TEST(PairedTest, OfFewPairsIsSciPysExactPermutationTest) {
  for (const json& row : Golden().at("exact")) {
    SCOPED_TRACE(row.dump());
    const PairedTest test = TestPairs(MakePairs(row), kSamples);
    EXPECT_NEAR(test.p, row.at("p"), 1e-12);
    EXPECT_EQ(test.method, Method::kExact);
  }
}

TEST(PairedTest, OfManyPairsIsNearSciPysRandomPermutationTest) {
  for (const json& row : Golden().at("monte_carlo")) {
    const double p = row.at("p");
    SCOPED_TRACE(p);
    const PairedTest test = TestPairs(MakePairs(row), 100'000);
    EXPECT_EQ(test.method, Method::kMonteCarlo);
    // Five standard errors of both.
    EXPECT_NEAR(test.p, p, 5 * std::sqrt(p * (1 - p) * (1 / 1e5 + 1 / 2e6)));
  }
}

TEST(PairedTest, OfMeansOverStepsIsSciPysExactPermutationTest) {
  for (const json& row : Golden().at("over_steps")) {
    std::vector<Pair> pairs;
    for (const json& pair : row.at("pairs")) {
      pairs.push_back({{pair[0][0], pair[0][1]}, {pair[1][0], pair[1][1]}});
    }
    EXPECT_NEAR(TestPairs(pairs, kSamples).p, row.at("p"), 1e-12);
  }
}

TEST(PairedTest, TellsTheDifferenceOfTheMeans) {
  EXPECT_DOUBLE_EQ(TestPairs(MakePairs({1, 2, 6}, {1, 1, 1}), kSamples).difference, 2);
  EXPECT_DOUBLE_EQ(TestPairs({{{{6, 3}, {1, 1}}}}, kSamples).difference, 1);
  EXPECT_DOUBLE_EQ(TestPairs(MakePairs({5}, {1}), kSamples).difference, 4);
  EXPECT_DOUBLE_EQ(TestPairs({{{{1, 0.5}, {2, 0.5}}}}, kSamples).difference, -2);
}

TEST(PairedTest, WithoutPairsOrWeightsDecidesNothing) {
  EXPECT_EQ(TestPairs({}, kSamples).p, 1);
  EXPECT_EQ(TestPairs({{{{1, 0}, {2, 0}}}}, kSamples).p, 1);
  const PairedTest one_sided = TestPairs({{{{1, 0}, {2, 3}}}}, kSamples);
  EXPECT_EQ(one_sided.p, 1);
  EXPECT_EQ(one_sided.difference, 0);
  EXPECT_EQ(TestPairs({{{{0, 0}, {2, 3}}}}, kSamples).p, 1);
  EXPECT_EQ(TestPairs({{{{2, 3}, {0, 0}}}}, kSamples).p, 1);
  const std::vector<Pair> weightless = {{{1, 0}, {2, 0}}, {{1, 0}, {5, 0}}};
  EXPECT_EQ(TestPairs(weightless, kSamples).p, 1);
}

// Every way of exchanging nothing but steps leaves both means at 0.
TEST(PairedTest, OfWeightsAloneDecidesNothing) {
  std::vector<Pair> pairs;
  for (int i = 0; i < 30; ++i) pairs.push_back({{0, 1.0 + i % 3}, {0, 5}});
  EXPECT_EQ(TestPairs(pairs, 500).p, 1);
  EXPECT_EQ(TestPairs(pairs, 500).method, Method::kMonteCarlo);
  pairs.resize(5);
  EXPECT_EQ(TestPairs(pairs, 500).p, 1);
  EXPECT_EQ(TestPairs(pairs, 500).method, Method::kExact);
}

// The random ways are part of the result: another program with the same generator draws the same.
TEST(PairedTest, DrawsTheSameWaysForEver) {
  std::vector<Pair> plain, over_steps;
  for (int i = 0; i < 100; ++i) {
    const double a = i * 7 % 11, b = i * 5 % 13;
    plain.push_back({{a}, {b}});
    over_steps.push_back({{a, 10.0 + i % 3}, {b, 10.0 + i % 7}});
  }
  const PairedTest test = TestPairs(plain, 1001);
  EXPECT_EQ(test.method, Method::kMonteCarlo);
  EXPECT_EQ(test.differing, 89);
  EXPECT_DOUBLE_EQ(test.difference, -1.01);
  EXPECT_EQ(test.p, 43.0 / 1002);
  EXPECT_EQ(TestPairs(plain, 1000).p, 43.0 / 1001);
  EXPECT_EQ(TestPairs(over_steps, 1001).p, 827.0 / 1002);
  EXPECT_EQ(TestPairs(over_steps, 997).p, 823.0 / 998);
}

TEST(PairedTest, EnumeratesWhatTakesNoMoreWaysThanSamples) {
  const std::vector<Pair> pairs = MakePairs({1, 2, 4, 8, 16}, {0, 0, 0, 0, 0});
  EXPECT_EQ(TestPairs(pairs, 16).method, Method::kExact);
  EXPECT_EQ(TestPairs(pairs, 16).p, 1.0 / 16);
  EXPECT_EQ(TestPairs(pairs, 15).method, Method::kMonteCarlo);
  EXPECT_EQ(TestPairs(pairs, 1).method, Method::kMonteCarlo);
}

TEST(PairedTest, OfThousandsOfClearPairsStaysAboveZero) {
  EXPECT_GT(TestPairs(Successes(5000, 0, 0), kSamples).p, 0);
}

// So small a difference in the last digits is rounding, and not one that an exchange must reach.
TEST(PairedTest, TakesEqualSumsAsEqual) {
  const PairedTest test = TestPairs(MakePairs({0.1, 0.2, 0.3, 0}, {0, 0, 0, 0.6}), kSamples);
  EXPECT_EQ(test.p, 1);
  std::vector<Pair> large = MakePairs({0.1, 0.2, 0.3, 0}, {0, 0, 0, 0.6});
  for (Pair& pair : large) {
    pair.a.amount *= 1 << 30;
    pair.b.amount *= 1 << 30;
  }
  EXPECT_EQ(TestPairs(large, kSamples).p, 1);
}

// It is a part of the means, whatever the sums are.
TEST(PairedTest, TellsSmallMeansOfManyStepsApart) {
  std::vector<Pair> pairs;
  for (int i = 0; i < 6; ++i) pairs.push_back({{1.001e6 + i, 1e6}, {1e6, 1e6}});
  EXPECT_EQ(TestPairs(pairs, kSamples).p, 2.0 / 64);
}

std::vector<double> AnyNumbers(size_t count) {
  std::vector<double> numbers;
  for (size_t i = 0; i < count; ++i) numbers.push_back(*rc::gen::inRange(-50, 50) / 8.0);
  return numbers;
}

// Plain means, or means over steps.
std::vector<Pair> AnyPairs(int most) {
  const auto count = static_cast<size_t>(*rc::gen::inRange(0, most));
  std::vector<Pair> pairs = MakePairs(AnyNumbers(count), AnyNumbers(count));
  if (*rc::gen::arbitrary<bool>()) {
    for (Pair& pair : pairs) {
      pair.a.weight = *rc::gen::inRange(0, 20);
      pair.b.weight = *rc::gen::inRange(0, 20);
    }
  }
  return pairs;
}

RC_GTEST_PROP(PairedTestProperties, PIsAProbabilityThatNoExchangeChanges, ()) {
  const std::vector<Pair> pairs = AnyPairs(60);
  const PairedTest test = TestPairs(pairs, 500);
  RC_ASSERT(test.p > 0 && test.p <= 1);
  const PairedTest exchanged = TestPairs(Exchanged(pairs), 500);
  RC_ASSERT(exchanged.p == test.p);
  RC_ASSERT(exchanged.difference == -test.difference);
}

RC_GTEST_PROP(PairedTestProperties, TheOrderOfEpisodesChangesNothing, ()) {
  std::vector<Pair> pairs = AnyPairs(60);
  for (Pair& pair : pairs) pair.a.amount /= 7;  // sums of these depend on their order
  const PairedTest test = TestPairs(pairs, 500);
  for (size_t i = pairs.size(); i > 1; --i) {
    std::swap(pairs[i - 1], pairs[*rc::gen::inRange<size_t>(0, i)]);
  }
  const PairedTest shuffled = TestPairs(pairs, 500);
  RC_ASSERT(shuffled.p == test.p);
  RC_ASSERT(shuffled.difference == test.difference);
}

RC_GTEST_PROP(PairedTestProperties, EqualEntriesHaveP1, ()) {
  std::vector<Pair> pairs = AnyPairs(60);
  for (Pair& pair : pairs) pair.b = pair.a;
  RC_ASSERT(TestPairs(pairs, 500).p == 1);
  RC_ASSERT(TestPairs(pairs, 500).differing == 0);
}

// The p-value by its definition, over every way of exchanging.
double Enumerated(const std::vector<Pair>& pairs) {
  const auto mean_difference = [&](uint64_t way) {
    Sample a{0, 0};
    Sample b{0, 0};
    for (size_t i = 0; i < pairs.size(); ++i) {
      const bool swap = (way >> i & 1) != 0;
      const Sample& first = swap ? pairs[i].b : pairs[i].a;
      const Sample& second = swap ? pairs[i].a : pairs[i].b;
      a = {a.amount + first.amount, a.weight + first.weight};
      b = {b.amount + second.amount, b.weight + second.weight};
    }
    return std::abs(a.amount / a.weight - b.amount / b.weight);
  };
  const uint64_t ways = uint64_t{1} << pairs.size();
  const double observed = mean_difference(0);
  int64_t reached = 0;
  for (uint64_t way = 0; way < ways; ++way) {
    if (mean_difference(way) >= observed - 1e-9) ++reached;
  }
  return static_cast<double>(reached) / static_cast<double>(ways);
}

TEST(IntervalOfDifference, OfSuccessesIsBonettAndPrices) {
  // 21 pairs, 1 and 7 of which differ: 2/23 - 8/23, with the error of 23 pairs.
  const auto interval = IntervalOfDifference(Successes(1, 7, 13));
  ASSERT_TRUE(interval.has_value());
  EXPECT_TRUE(interval->of_proportions);
  EXPECT_NEAR(interval->low, -0.50836, 1e-4);
  EXPECT_NEAR(interval->high, -0.01338, 1e-4);
}

TEST(IntervalOfDifference, OfSuccessesThatAreAllEqualHasAWidth) {
  const auto interval = IntervalOfDifference(Successes(0, 0, 100));
  EXPECT_LT(interval->low, -0.02);
  EXPECT_GT(interval->high, 0.02);
}

TEST(IntervalOfDifference, OfNumbersIsThatOfTheNormalDistribution) {
  const auto interval = IntervalOfDifference(MakePairs({2, 4, 6, 8}, {1, 2, 3, 4}));
  ASSERT_TRUE(interval.has_value());
  EXPECT_FALSE(interval->of_proportions);
  EXPECT_NEAR(interval->low, 2.5 - 1.2651511, 1e-6);  // 1.96 standard errors of sqrt(5/3)/2
  EXPECT_NEAR(interval->high, 2.5 + 1.2651511, 1e-6);
}

TEST(IntervalOfDifference, OfProportionsNeedsBothResultsOfEachPair) {
  EXPECT_FALSE(IntervalOfDifference(MakePairs({1, 0, 1}, {0.5, 2, 3}))->of_proportions);
  EXPECT_FALSE(IntervalOfDifference(MakePairs({0.5, 2, 3}, {1, 0, 1}))->of_proportions);
}

TEST(IntervalOfDifference, NeedsTwoPairs) {
  EXPECT_FALSE(IntervalOfDifference(MakePairs({1}, {0})).has_value());
}

RC_GTEST_PROP(PairedTestProperties, ExchangedEntriesHaveTheIntervalTurned, ()) {
  const auto count = *rc::gen::inRange<size_t>(2, 20);
  const std::vector<Pair> pairs = MakePairs(AnyNumbers(count), AnyNumbers(count));
  const auto interval = IntervalOfDifference(pairs);
  const auto turned = IntervalOfDifference(Exchanged(pairs));
  RC_ASSERT(std::abs(interval->low + turned->high) < 1e-9);
  RC_ASSERT(std::abs(interval->high + turned->low) < 1e-9);
}

RC_GTEST_PROP(PairedTestProperties, TheClosedFormIsTheEnumeration, ()) {
  const std::vector<Pair> pairs =
      Successes(*rc::gen::inRange(0, 6), *rc::gen::inRange(0, 6), *rc::gen::inRange(1, 3));
  const PairedTest test = TestPairs(pairs, 1);
  RC_ASSERT(test.method == Method::kExact);
  RC_ASSERT(std::abs(test.p - Enumerated(pairs)) < 1e-12);
}

RC_GTEST_PROP(PairedTestProperties, TheExactTestIsTheEnumeration, ()) {
  const auto count = *rc::gen::inRange<size_t>(1, 10);
  std::vector<Pair> pairs = MakePairs(AnyNumbers(count), AnyNumbers(count));
  const bool over_steps = *rc::gen::arbitrary<bool>();
  for (Pair& pair : pairs) {
    if (!over_steps) break;
    pair.a.weight = *rc::gen::inRange(1, 20);
    pair.b.weight = *rc::gen::inRange(1, 20);
  }
  const PairedTest test = TestPairs(pairs, 1 << 10);
  RC_ASSERT(test.method == Method::kExact);
  RC_ASSERT(std::abs(test.p - Enumerated(pairs)) < 1e-12);
}

RC_GTEST_PROP(PairedTestProperties, RandomWaysAreNearTheExactTest, ()) {
  std::vector<Pair> pairs = MakePairs(AnyNumbers(14), AnyNumbers(14));
  const double exact = TestPairs(pairs, 1 << 14).p;
  const double random = TestPairs(pairs, 4000).p;
  RC_ASSERT(std::abs(random - exact) <= 6 * std::sqrt(0.25 / 4000) + 1.0 / 4000);
}

}  // namespace
}  // namespace myograde::scoring
