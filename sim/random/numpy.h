// NumPy's random streams, bit for bit: the generators that the official
// environments draw from. Algorithms as documented by NumPy for SeedSequence
// and PCG64 (O'Neill's PCG XSL RR 128/64, SeedSequence after her seed_seq
// design) and by Matsumoto and Nishimura for MT19937.
#pragma once

#include <array>
#include <cstdint>

namespace myograde::sim {

// numpy.random.Generator(PCG64(SeedSequence(seed))).
class NumpyGenerator {
 public:
  explicit NumpyGenerator(uint64_t seed);

  uint64_t Next64();
  uint32_t Next32();             // keeps the other half of a 64-bit draw for the next call
  double Random();               // [0, 1), 53 bits
  double Uniform(double low, double high);
  uint32_t Integers(uint32_t n);  // integers(0, n), choice(n): Lemire's method. REQUIRES n > 0
  double Normal(double scale);    // normal(0, scale): Marsaglia and Tsang's ziggurat of 256 layers

  // 128-bit state and increment as NumPy shows them in bit_generator.state.
  unsigned __int128 state() const { return state_; }
  unsigned __int128 increment() const { return increment_; }

 private:
  unsigned __int128 state_;
  unsigned __int128 increment_;
  bool has_half_ = false;
  uint32_t half_ = 0;
};

// The legacy global generator, numpy.random.seed(seed).
class LegacyNumpyGenerator {
 public:
  explicit LegacyNumpyGenerator(uint32_t seed);

  uint32_t Next32();
  double Random();  // [0, 1), 53 bits of two draws
  double Uniform(double low, double high);

 private:
  std::array<uint32_t, 624> state_;
  int next_ = 624;
};

}  // namespace myograde::sim
