#include "sim/random/numpy.h"

#include <bit>
#include <cassert>
#include <cmath>

namespace myograde::sim {
namespace {

// Constants of NumPy's SeedSequence, as its documentation and O'Neill's
// description of the hash publish them.
constexpr int kPoolWords = 4;
constexpr uint32_t kFillHash = 0x43b0d7e5;
constexpr uint32_t kFillHashStep = 0x931e8875;
constexpr uint32_t kOutputHash = 0x8b51f9dd;
constexpr uint32_t kOutputHashStep = 0x58f38ded;
constexpr uint32_t kMixLeft = 0xca01f9dd;
constexpr uint32_t kMixRight = 0x4973f715;

// One keyed hash of a word; the key moves on with each use.
class WordHash {
 public:
  WordHash(uint32_t key, uint32_t step) : key_(key), step_(step) {}

  uint32_t operator()(uint32_t word) {
    word ^= key_;
    key_ *= step_;
    word *= key_;
    return word ^ (word >> 16);
  }

 private:
  uint32_t key_;
  uint32_t step_;
};

uint32_t Mix(uint32_t x, uint32_t y) {
  const uint32_t mixed = kMixLeft * x - kMixRight * y;
  return mixed ^ (mixed >> 16);
}

// SeedSequence(seed).generate_state(4, uint64). A seed of up to 64 bits never
// has more words of entropy than the pool holds.
std::array<uint64_t, 4> SeedState(uint64_t seed) {
  const std::array<uint32_t, kPoolWords> entropy = {static_cast<uint32_t>(seed),
                                                    static_cast<uint32_t>(seed >> 32), 0, 0};
  std::array<uint32_t, kPoolWords> pool;
  WordHash fill(kFillHash, kFillHashStep);
  for (int i = 0; i < kPoolWords; ++i) pool[i] = fill(entropy[i]);
  for (int from = 0; from < kPoolWords; ++from) {
    for (int to = 0; to < kPoolWords; ++to) {
      if (from != to) pool[to] = Mix(pool[to], fill(pool[from]));
    }
  }
  WordHash output(kOutputHash, kOutputHashStep);
  std::array<uint64_t, 4> state;
  for (int i = 0; i < 4; ++i) {
    const uint64_t low = output(pool[(2 * i) % kPoolWords]);
    const uint64_t high = output(pool[(2 * i + 1) % kPoolWords]);
    state[i] = low | high << 32;
  }
  return state;
}

using uint128 = unsigned __int128;

uint128 Wide(uint64_t high, uint64_t low) { return uint128{high} << 64 | low; }

uint128 Advance(uint128 state, uint128 increment) {
  return state * Wide(0x2360ed051fc65da4, 0x4385df649fccf645) + increment;
}

constexpr double kTwoPowMinus53 = 1.0 / 9007199254740992.0;

// The ziggurat of the normal distribution: 256 layers of equal area under exp(-x^2 / 2), the lowest
// of which has the tail. NumPy has these numbers as tables. They come out of the published
// recurrence (Marsaglia and Tsang 2000) in double precision, with one density rounded up.
struct Ziggurat {
  static constexpr int kLayers = 256;
  static constexpr double kTail = 3.6541528853610088;        // where the tail begins
  static constexpr double kArea = 0.0049286732339746518877;  // of a layer
  static constexpr double kSteps = 4503599627370496;         // 2^52, in a layer's width

  std::array<double, kLayers> step;      // a layer's width / 2^52
  std::array<uint64_t, kLayers> inside;  // below this many steps x is surely under the curve
  std::array<double, kLayers> density;   // at a layer's width

  Ziggurat() {
    constexpr int kRoundedUp = 38;
    double x = kTail;
    for (int i = kLayers - 1; i > 0; --i) {
      if (i < kLayers - 1) x = std::sqrt(-2 * std::log(kArea / x + density[i + 1]));
      step[i] = x / kSteps;
      density[i] = std::exp(-0.5 * x * x);
      if (i == kRoundedUp) density[i] = std::nextafter(density[i], 1.0);
    }
    step[0] = kArea / density[kLayers - 1] / kSteps;
    density[0] = 1;
    inside[0] = static_cast<uint64_t>(std::llrint(kTail / step[0]));
    inside[1] = 0;
    for (int i = 2; i < kLayers; ++i) {
      inside[i] = static_cast<uint64_t>(std::llrint(step[i - 1] * kSteps / step[i]));
    }
  }
};

}  // namespace

NumpyGenerator::NumpyGenerator(uint64_t seed) {
  const auto words = SeedState(seed);
  increment_ = Wide(words[2], words[3]) << 1 | 1;
  state_ = Advance(0, increment_) + Wide(words[0], words[1]);
  state_ = Advance(state_, increment_);
}

uint64_t NumpyGenerator::Next64() {
  state_ = Advance(state_, increment_);
  const auto high = static_cast<uint64_t>(state_ >> 64);
  const auto low = static_cast<uint64_t>(state_);
  return std::rotr(high ^ low, static_cast<int>(high >> 58));
}

uint32_t NumpyGenerator::Next32() {
  if (has_half_) {
    has_half_ = false;
    return half_;
  }
  const uint64_t word = Next64();
  has_half_ = true;
  half_ = static_cast<uint32_t>(word >> 32);
  return static_cast<uint32_t>(word);
}

double NumpyGenerator::Random() {
  return static_cast<double>(Next64() >> 11) * kTwoPowMinus53;
}

double NumpyGenerator::Uniform(double low, double high) { return low + (high - low) * Random(); }

uint32_t NumpyGenerator::Integers(uint32_t n) {
  assert(n > 0);
  if (n == 1) return 0;  // NumPy draws nothing for a range of one value
  uint64_t product = uint64_t{Next32()} * n;
  if (static_cast<uint32_t>(product) < n) {
    const uint32_t threshold = (0u - n) % n;
    while (static_cast<uint32_t>(product) < threshold) product = uint64_t{Next32()} * n;
  }
  return static_cast<uint32_t>(product >> 32);
}

double NumpyGenerator::Normal(double scale) {
  static const Ziggurat ziggurat;
  for (;;) {
    const uint64_t bits = Next64();
    const size_t layer = bits & 0xff;
    const uint64_t steps = bits >> 9 & ((uint64_t{1} << 52) - 1);
    double x = static_cast<double>(steps) * ziggurat.step[layer];
    if (bits & 0x100) x = -x;
    if (steps < ziggurat.inside[layer]) return scale * x;
    if (layer == 0) {
      double beyond;
      double height;
      do {
        beyond = -(1 / Ziggurat::kTail) * std::log1p(-Random());
        height = -std::log1p(-Random());
      } while (height + height <= beyond * beyond);
      beyond += Ziggurat::kTail;
      return scale * (steps & 0x100 ? -beyond : beyond);
    }
    const double drop = ziggurat.density[layer - 1] - ziggurat.density[layer];
    if (drop * Random() + ziggurat.density[layer] < std::exp(-0.5 * x * x)) return scale * x;
  }
}

LegacyNumpyGenerator::LegacyNumpyGenerator(uint32_t seed) {
  state_[0] = seed;
  for (uint32_t i = 1; i < state_.size(); ++i) {
    state_[i] = 1812433253u * (state_[i - 1] ^ (state_[i - 1] >> 30)) + i;
  }
}

uint32_t LegacyNumpyGenerator::Next32() {
  constexpr int kSize = 624;
  constexpr int kShift = 397;
  if (next_ == kSize) {
    for (int i = 0; i < kSize; ++i) {
      const uint32_t joined =
          (state_[i] & 0x80000000u) | (state_[(i + 1) % kSize] & 0x7fffffffu);
      state_[i] = state_[(i + kShift) % kSize] ^ (joined >> 1) ^ (joined & 1 ? 0x9908b0dfu : 0u);
    }
    next_ = 0;
  }
  uint32_t word = state_[next_++];
  word ^= word >> 11;
  word ^= (word << 7) & 0x9d2c5680u;
  word ^= (word << 15) & 0xefc60000u;
  return word ^ (word >> 18);
}

double LegacyNumpyGenerator::Random() {
  const uint32_t high = Next32() >> 5;
  const uint32_t low = Next32() >> 6;
  return (high * 67108864.0 + low) * kTwoPowMinus53;
}

double LegacyNumpyGenerator::Uniform(double low, double high) {
  return low + (high - low) * Random();
}

}  // namespace myograde::sim
