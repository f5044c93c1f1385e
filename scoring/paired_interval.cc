#include <algorithm>
#include <cmath>

#include "scoring/paired_test.h"

namespace myograde::scoring {
namespace {

// The 97.5 % quantile of the normal distribution.
constexpr double kPairedHalfWidth = 1.959963984540054;

bool IsZeroOrOne(double amount) { return amount == 0 || amount == 1; }

DifferenceInterval OfProportions(std::span<const Pair> pairs) {
  double only_a = 0;
  double only_b = 0;
  for (const Pair& pair : pairs) {
    if (pair.a.amount > pair.b.amount) ++only_a;
    if (pair.a.amount < pair.b.amount) ++only_b;
  }
  // As if one more pair had differed in either direction.
  const double n = static_cast<double>(pairs.size()) + 2;
  const double p_a = (only_a + 1) / n;
  const double p_b = (only_b + 1) / n;
  const double difference = p_a - p_b;
  const double half =
      kPairedHalfWidth * std::sqrt((p_a + p_b - difference * difference) / n);
  return {std::max(-1.0, difference - half), std::min(1.0, difference + half), true};
}

DifferenceInterval OfMeans(std::span<const Pair> pairs) {
  const double n = static_cast<double>(pairs.size());
  double sum = 0;
  for (const Pair& pair : pairs) sum += pair.a.amount - pair.b.amount;
  const double mean = sum / n;
  double squares = 0;
  for (const Pair& pair : pairs) {
    const double from_mean = pair.a.amount - pair.b.amount - mean;
    squares += from_mean * from_mean;
  }
  const double half = kPairedHalfWidth * std::sqrt(squares / (n - 1) / n);
  return {mean - half, mean + half, false};
}

}  // namespace

std::optional<DifferenceInterval> IntervalOfDifference(std::span<const Pair> pairs) {
  if (pairs.size() < 2) return std::nullopt;
  const bool proportions = std::all_of(pairs.begin(), pairs.end(), [](const Pair& pair) {
    return IsZeroOrOne(pair.a.amount) && IsZeroOrOne(pair.b.amount);
  });
  return proportions ? OfProportions(pairs) : OfMeans(pairs);
}

}  // namespace myograde::scoring
