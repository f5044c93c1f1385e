// The tables behind layout.h: what the vectors of one track hold, entry by entry.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/layout.h"

namespace myograde::layout_tables {

// One entry of a part: its own name ("" if the part is that single number) and its bounds.
struct Entry {
  std::string_view name;
  Bounds bounds;
};

// A vector that is put together part by part. `parts`, `names` and `bounds` stay valid as long
// as the object and are complete once the last part is added.
class VectorLayout {
 public:
  VectorLayout() = default;
  VectorLayout(VectorLayout&&) = default;

  void Add(std::string_view name, std::string_view unit, std::string_view meaning,
           const std::vector<Entry>& entries);

  std::span<const Part> parts() const { return parts_; }
  // The bounds of the entries, in order.
  const std::vector<Bounds>& bounds() const { return bounds_; }
  // The names of the entries ("part.entry"), in order.
  const std::vector<std::string>& names() const { return names_; }

 private:
  std::vector<Part> parts_;
  std::vector<std::string> names_;
  std::vector<Bounds> bounds_;
};

// The same bounds for each of `names`.
std::vector<Entry> Entries(std::span<const std::string_view> names, Bounds bounds);

struct TrackLayout {
  VectorLayout observation;
  VectorLayout action;                // bounds: the normalized convention
  std::vector<Bounds> direct_bounds;  // of the action in the direct convention
};

TrackLayout ManipulationLayout();
TrackLayout LocomotionLayout();

}  // namespace myograde::layout_tables
