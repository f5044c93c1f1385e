// What the tracks' details are made of. Details are measured beside the facts, for pages, plots and
// reports: no verdict, metric, rank, digest or Merkle leaf depends on them, and results of earlier
// versions have none.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace myograde {

// The angles that a joint had after the control steps of an episode, and the limits that the model
// gives it, all in rad. As JSON: [low, high, limit_low, limit_high].
struct JointRange {
  double low = 0;
  double high = 0;
  double limit_low = 0;
  double limit_high = 0;
};

// Values that JSON shows as an object with a key for each name. Refers to both arrays.
template <typename Value, size_t n>
struct ByName {
  const std::array<std::string_view, n>& names;
  Value& values;  // an array as long as `names`; may be const
};
template <typename Values, size_t n>
ByName(const std::array<std::string_view, n>&, Values&) -> ByName<Values, n>;

}  // namespace myograde
