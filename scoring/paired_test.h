// Whether two entries that played the same episodes differ by more than the episodes' luck: the
// paired permutation test (R. A. Fisher, The Design of Experiments, 1935, section 21; P. Good,
// Permutation, Parametric and Bootstrap Tests of Hypotheses, 3rd edition, 2005, section 3.2). If
// the two were equally good, it would be chance which of them got which of the two results of an
// episode, so the difference of their means is compared with those that arise when the two results
// of every episode are exchanged at random. The p-value is two-sided: how often such a difference is
// at least as large, in either direction.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace myograde::scoring {

// What one entry has in one episode. Its mean over episodes is the sum of amounts by the sum of
// weights: 1 each for a plain mean, the steps for a mean over steps.
struct Sample {
  double amount = 0;
  double weight = 1;
};

// The same episode of two entries. One in which either has no value is not a pair: the caller leaves it
// out, as nothing can be exchanged there.
struct Pair {
  Sample a;
  Sample b;
};

struct PairedTest {
  // kExact: over all ways of exchanging. kMonteCarlo: over random ones.
  enum class Method { kExact, kMonteCarlo };

  double p = 1;           // in (0, 1]; 1 if no pair differs
  double difference = 0;  // mean of a less mean of b; 0 where a mean has no weight
  int64_t pairs = 0;
  int64_t differing = 0;  // pairs whose two results differ; the others decide nothing
  Method method = Method::kExact;
};

// Exact in closed form if all differences are of one size, as those of successes are: the number of
// differing pairs in which a is ahead is then binomial with probability 1/2 (McNemar's exact test).
// Exact by enumeration if that takes at most `samples` ways. Otherwise `samples` random ways, of
// which b reach the observed difference: p = (1 + b) / (1 + samples) (Davison and Hinkley, Bootstrap
// Methods and their Application, 1997, section 4.2.5). They come from SplitMix64 (Steele, Lea and
// Flood, OOPSLA 2014) with the same start for every test, so that p is a function of the pairs. It
// depends neither on their order nor on who is a and who b.
// REQUIRES: finite amounts, finite weights >= 0, samples >= 1.
PairedTest TestPairs(std::span<const Pair> pairs, int64_t samples);

// The 95 % interval of the mean of the differences a less b.
struct DifferenceInterval {
  double low = 0;
  double high = 0;
  // Whether every result is 0 or 1 in it, as successes are.
  bool of_proportions = false;
};

// Of results that are all 0 or 1: the adjusted Wald interval for paired proportions (D. G. Bonett and
// R. M. Price, Adjusted Wald confidence interval for a difference of binomial proportions based on
// paired data, 2012), which keeps its level where few pairs differ. Else that of the normal
// distribution, as of other means. nullopt with fewer than two pairs.
// REQUIRES: finite amounts, weights of 1.
std::optional<DifferenceInterval> IntervalOfDifference(std::span<const Pair> pairs);

}  // namespace myograde::scoring
