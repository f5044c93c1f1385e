#include "protocol/layout.h"

#include "protocol/layout_tables.h"

namespace myograde {
namespace layout_tables {

void VectorLayout::Add(std::string_view name, std::string_view unit, std::string_view meaning,
                       const std::vector<Entry>& entries) {
  parts_.push_back({.name = name,
                    .offset = static_cast<int>(names_.size()),
                    .size = static_cast<int>(entries.size()),
                    .unit = unit,
                    .meaning = meaning});
  for (const Entry& entry : entries) {
    std::string full(name);
    if (!entry.name.empty()) full.append(".").append(entry.name);
    names_.push_back(std::move(full));
    bounds_.push_back(entry.bounds);
  }
}

std::vector<Entry> Entries(std::span<const std::string_view> names, Bounds bounds) {
  std::vector<Entry> entries;
  for (const std::string_view name : names) entries.push_back({name, bounds});
  return entries;
}

}  // namespace layout_tables

namespace {

using layout_tables::TrackLayout;

// A track's tables, built once, with views of their names beside them.
struct Cached {
  explicit Cached(TrackLayout tables)
      : layout(std::move(tables)),
        observation_names(layout.observation.names().begin(), layout.observation.names().end()),
        action_names(layout.action.names().begin(), layout.action.names().end()) {}

  TrackLayout layout;
  std::vector<std::string_view> observation_names;
  std::vector<std::string_view> action_names;
};

const Cached& Of(TrackKind kind) {
  static const Cached manipulation(layout_tables::ManipulationLayout());
  static const Cached locomotion(layout_tables::LocomotionLayout());
  return kind == TrackKind::kManipulation ? manipulation : locomotion;
}

}  // namespace

std::span<const Part> ObservationLayout(TrackKind kind) {
  return Of(kind).layout.observation.parts();
}

std::span<const Part> ActionLayout(TrackKind kind) { return Of(kind).layout.action.parts(); }

int ObservationSize(TrackKind kind) { return static_cast<int>(Of(kind).observation_names.size()); }

int ActionSize(TrackKind kind) { return static_cast<int>(Of(kind).action_names.size()); }

std::span<const std::string_view> ObservationNames(TrackKind kind) {
  return Of(kind).observation_names;
}

std::span<const std::string_view> ActionNames(TrackKind kind) { return Of(kind).action_names; }

std::vector<Bounds> ActionBounds(TrackKind kind, ActionConvention convention) {
  const TrackLayout& layout = Of(kind).layout;
  return convention == ActionConvention::kDirect ? layout.direct_bounds : layout.action.bounds();
}

std::vector<Bounds> ObservationBounds(TrackKind kind) {
  return Of(kind).layout.observation.bounds();
}

double ControlPeriod(TrackKind kind) { return kind == TrackKind::kManipulation ? 0.01 : 0.005; }

}  // namespace myograde
