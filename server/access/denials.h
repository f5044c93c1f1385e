// Counts denied requests, so that equal ones share a row of the store: whoever makes many of them
// fills neither memory nor disk.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include <absl/time/time.h>

namespace myograde::server {

struct Denial {
  std::string who;     // an Identity's key
  std::string role;
  std::string action;
  std::string why;

  auto operator<=>(const Denial&) const = default;
};

struct CountedDenial {
  Denial denial;
  int64_t count = 0;
};

// For one thread. Times are monotonic.
class DenialCounter {
 public:
  // Between two rows of equal denials.
  static constexpr absl::Duration kEvery = absl::Minutes(1);

  // Beyond `most` different ones in a minute, all others are counted as one, of `OthersKey`.
  // REQUIRES: most > 0.
  explicit DenialCounter(size_t most) : most_(most) {}

  void Add(const Denial& denial);
  // What is to be written at `now`: the first of a kind at once, equal ones a minute later.
  std::vector<CountedDenial> TakeDue(absl::Duration now);
  // All that has not been written.
  std::vector<CountedDenial> TakeAll() { return TakeDue(absl::InfiniteDuration()); }
  // Adds what could not be written.
  void Return(const std::vector<CountedDenial>& denials);

  static Denial Others();

 private:
  struct Kind {
    int64_t count = 0;  // not written yet
    absl::Duration written = -absl::InfiniteDuration();
  };

  Kind& KindOf(const Denial& denial);

  const size_t most_;
  std::map<Denial, Kind> kinds_;
};

}  // namespace myograde::server
