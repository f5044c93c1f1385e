#include "protocol/policy/layout.h"

#include <utility>

namespace myograde {

std::vector<LayoutEntry> LayoutEntries(std::span<const std::string_view> names, Bounds bounds) {
  std::vector<LayoutEntry> entries;
  for (const std::string_view name : names) entries.push_back({name, bounds});
  return entries;
}

void VectorLayout::Add(std::string_view name, std::string_view unit, std::string_view meaning,
                       const std::vector<LayoutEntry>& entries) {
  parts_.push_back({.name = name,
                    .offset = size(),
                    .size = static_cast<int>(entries.size()),
                    .unit = unit,
                    .meaning = meaning});
  for (const LayoutEntry& entry : entries) {
    std::string full(name);
    if (!entry.name.empty()) full.append(".").append(entry.name);
    names_.push_back(full_names_.emplace_back(std::move(full)));
    bounds_.push_back(entry.bounds);
  }
}

}  // namespace myograde
