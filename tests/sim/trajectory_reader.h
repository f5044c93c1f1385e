// Reads a trajectory file as sim/trajectory/README.md describes it, for tests.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::sim {

struct ReadTrajectory {
  nlohmann::json head;

  // The whole numbers of an array's channel.
  std::vector<int> Numbers(const std::string& array, size_t channel) const;
  // What they stand for.
  std::vector<double> Values(const std::string& array, size_t channel) const;

  std::string arrays;
};

// InvalidArgumentError: what is wrong with it.
absl::StatusOr<ReadTrajectory> ParseTrajectory(std::string_view file);

}  // namespace myograde::sim
