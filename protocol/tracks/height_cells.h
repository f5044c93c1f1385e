// The part of an observation that is a map of 10 x 10 heights (sim/model/height_map.h).
#pragma once

#include <string>
#include <vector>

#include "protocol/policy/layout.h"

namespace myograde {

// "row0_col0" to "row9_col9", with the same bounds.
inline std::vector<LayoutEntry> HeightCells(Bounds bounds) {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (int row = 0; row < 10; ++row) {
      for (int column = 0; column < 10; ++column) {
        result.push_back("row" + std::to_string(row) + "_col" + std::to_string(column));
      }
    }
    return result;
  }();
  std::vector<LayoutEntry> cells;
  for (const std::string& name : names) cells.push_back({name, bounds});
  return cells;
}

}  // namespace myograde
