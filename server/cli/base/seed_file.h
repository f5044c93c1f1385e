// Files of seeds.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

namespace myograde::server {

// Reads a seed list: whole numbers from 0 to 2^63-1 without repetition, 1 to 10,000 of them, in
// JSON as ParseSeeds takes them or one a line ('#' begins a comment). InvalidArgumentError names
// the file and the line or entry.
absl::StatusOr<std::vector<uint64_t>> ReadSeeds(const std::string& path);

}  // namespace myograde::server
