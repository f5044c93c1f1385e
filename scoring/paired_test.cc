#include "scoring/paired_test.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

namespace myograde::scoring {
namespace {

// Sums of decimal fractions that are equal by the numbers differ in their last digits: a difference
// that is smaller than the observed one by less than this part of the means still reaches it.
constexpr double kRounding = 1e-12;

constexpr uint64_t kFirstState = 0x4d796f4772616465;  // "MyoGrade"
constexpr size_t kSignsOfADraw = 64;

// The difference between the two results of a pair, in the direction in which it is positive.
struct Difference {
  double amount;
  double weight;
  bool reversed = false;  // b is the larger one

  auto key() const { return std::pair(amount, weight); }
};

struct Differences {
  std::vector<Difference> all;  // sorted, so that the order of episodes changes no digit of a sum
  Sample a;                     // the sums of each entry
  Sample b;
  double size = 0;              // of all amounts, without their signs
  bool even = true;             // no pair's two weights differ

  double amounts() const { return a.amount + b.amount; }
  double weights() const { return a.weight + b.weight; }
};

class SplitMix64 {
 public:
  uint64_t Next() {
    state_ += 0x9e3779b97f4a7c15;
    uint64_t mixed = state_;
    mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9;
    mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111eb;
    return mixed ^ (mixed >> 31);
  }

 private:
  uint64_t state_ = kFirstState;
};

// Every sum runs over sorted numbers, for the same reason. `number`: of a pair.
template <typename NumberOf>
double SortedSum(std::span<const Pair> pairs, NumberOf number) {
  std::vector<double> numbers;
  for (const Pair& pair : pairs) numbers.push_back(number(pair));
  std::sort(numbers.begin(), numbers.end());
  return std::accumulate(numbers.begin(), numbers.end(), 0.0);
}

Differences ComputeDifferences(std::span<const Pair> pairs) {
  Differences found;
  for (const auto& [a, b] : pairs) {
    Difference own{a.amount - b.amount, a.weight - b.weight};
    if (own.key() == std::pair(0.0, 0.0)) continue;
    if (own.key() < std::pair(0.0, 0.0)) own = {-own.amount, -own.weight, true};
    found.even = found.even && own.weight == 0;
    found.all.push_back(own);
  }
  std::sort(found.all.begin(), found.all.end(),
            [](const Difference& x, const Difference& y) { return x.key() < y.key(); });
  found.a.amount = SortedSum(pairs, [](const Pair& pair) { return pair.a.amount; });
  found.a.weight = SortedSum(pairs, [](const Pair& pair) { return pair.a.weight; });
  found.b.amount = SortedSum(pairs, [](const Pair& pair) { return pair.b.amount; });
  found.b.weight = SortedSum(pairs, [](const Pair& pair) { return pair.b.weight; });
  found.size = SortedSum(pairs, [](const Pair& pair) { return std::abs(pair.a.amount); }) +
               SortedSum(pairs, [](const Pair& pair) { return std::abs(pair.b.amount); });
  return found;
}

// The difference of the two means. Without any weight on one side it is larger than any.
double MeansDifference(const Sample& a, const Sample& b) {
  if (a.weight <= 0 || b.weight <= 0) return std::numeric_limits<double>::infinity();
  return a.amount / a.weight - b.amount / b.weight;
}

// The same, if a has `amount` and `weight` more than b.
double MeansDifference(const Differences& all, double amount, double weight) {
  return MeansDifference({(all.amounts() + amount) / 2, (all.weights() + weight) / 2},
                         {(all.amounts() - amount) / 2, (all.weights() - weight) / 2});
}

// With its sign turned if the lowest bit is set.
double WithSign(double number, uint64_t sign) {
  return std::bit_cast<double>(std::bit_cast<uint64_t>(number) ^ (sign << 63));
}

// The same, if the pairs whose bit `next` gives as 1 are turned.
template <typename NextBit>
double Exchanged(const Differences& all, NextBit next) {
  double amount = 0;
  double weight = 0;
  for (const Difference& difference : all.all) {
    const uint64_t sign = next();
    amount += WithSign(difference.amount, sign);
    weight += WithSign(difference.weight, sign);
  }
  return MeansDifference(all, amount, weight);
}

// What reaches the observed difference.
double ComputeThreshold(const Differences& all, double observed) {
  return std::abs(observed) - kRounding * all.size / all.weights();
}

// n over k by 2^n. Mantissa and exponent are kept apart, as 2^-n alone may be no double.
double HalfBinomial(int64_t n, int64_t k) {
  double mantissa = 1;
  int64_t exponent = -n;
  for (int64_t i = 1; i <= k; ++i) {
    int moved = 0;
    mantissa = std::frexp(mantissa * static_cast<double>(n - k + i) / static_cast<double>(i),
                          &moved);
    exponent += moved;
  }
  return std::ldexp(mantissa, static_cast<int>(exponent));
}

// Twice the probability of at most `fewer` of n, as both tails are alike.
double BinomialP(int64_t n, int64_t fewer) {
  double term = HalfBinomial(n, fewer);
  double sum = 0;
  for (int64_t i = fewer; i >= 0; --i) {
    sum += term;
    term *= static_cast<double>(i) / static_cast<double>(n - i + 1);
  }
  return std::clamp(2 * sum, std::numeric_limits<double>::min(), 1.0);
}

bool SameSize(const Differences& all) {
  return all.even && all.all.front().amount == all.all.back().amount;
}

double ClosedP(const Differences& all) {
  const auto n = std::ssize(all.all);
  const auto reversed = std::count_if(all.all.begin(), all.all.end(),
                                      [](const Difference& own) { return own.reversed; });
  return BinomialP(n, std::min<int64_t>(reversed, n - reversed));
}

// Exchanging all pairs gives the same size of the difference, so the last pair stays as it is.
double EnumeratedP(const Differences& all, double threshold) {
  const uint64_t ways = uint64_t{1} << (all.all.size() - 1);
  uint64_t reached = 0;
  for (uint64_t way = 0; way < ways; ++way) {
    uint64_t signs = way;
    const double difference = Exchanged(all, [&] {
      const uint64_t sign = signs & 1;
      signs >>= 1;
      return sign;
    });
    if (std::abs(difference) >= threshold) ++reached;
  }
  return static_cast<double>(reached) / static_cast<double>(ways);
}

// What a has more than b in random ways of exchanging. Each way is a sum of its own, and several at
// once keep the processor busy.
constexpr size_t kWaysAtOnce = 8;
struct RandomSums {
  std::array<double, kWaysAtOnce> amounts{};
  std::array<double, kWaysAtOnce> weights{};
};

RandomSums DrawSums(const Differences& all, SplitMix64& random) {
  RandomSums sums;
  std::array<uint64_t, kWaysAtOnce> signs{};
  for (size_t i = 0; i < all.all.size(); ++i) {
    if (i % kSignsOfADraw == 0) {
      for (uint64_t& own : signs) own = random.Next();
    }
    const Difference& difference = all.all[i];
    for (size_t way = 0; way < kWaysAtOnce; ++way) {
      sums.amounts[way] += WithSign(difference.amount, signs[way]);
    }
    for (size_t way = 0; !all.even && way < kWaysAtOnce; ++way) {
      sums.weights[way] += WithSign(difference.weight, signs[way]);
    }
    for (uint64_t& own : signs) own >>= 1;
  }
  return sums;
}

double MonteCarloP(const Differences& all, double threshold, int64_t samples) {
  SplitMix64 random;
  int64_t reached = 0;
  for (int64_t drawn = 0; drawn < samples; drawn += kWaysAtOnce) {
    const RandomSums sums = DrawSums(all, random);
    const auto ways = std::min<int64_t>(kWaysAtOnce, samples - drawn);
    for (size_t way = 0; way < static_cast<size_t>(ways); ++way) {
      const double difference = MeansDifference(all, sums.amounts[way], sums.weights[way]);
      if (std::abs(difference) >= threshold) ++reached;
    }
  }
  return static_cast<double>(1 + reached) / static_cast<double>(1 + samples);
}

// n pairs have 2^(n - 1) ways.
bool CanEnumerate(const Differences& all, int64_t samples) {
  return all.all.size() <= std::bit_width(static_cast<uint64_t>(samples));
}

}  // namespace

PairedTest TestPairs(std::span<const Pair> pairs, int64_t samples) {
  const Differences all = ComputeDifferences(pairs);
  PairedTest test{.pairs = std::ssize(pairs), .differing = std::ssize(all.all)};
  if (all.all.empty() || all.weights() <= 0) return test;
  const double observed = MeansDifference(all.a, all.b);
  test.difference = std::isfinite(observed) ? observed : 0;
  const double threshold = ComputeThreshold(all, observed);
  if (SameSize(all)) {
    test.p = ClosedP(all);
  } else if (CanEnumerate(all, samples)) {
    test.p = EnumeratedP(all, threshold);
  } else {
    test.method = PairedTest::Method::kMonteCarlo;
    test.p = MonteCarloP(all, threshold, samples);
  }
  return test;
}

}  // namespace myograde::scoring
