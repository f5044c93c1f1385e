// How much room a disk has.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace myograde::server {

struct DiskSpace {
  int64_t size = 0;  // bytes
  int64_t used = 0;
  int64_t free = 0;  // without what is kept for root
};

// Of the file system that `path` is on; nullopt if it can't be told.
std::optional<DiskSpace> DiskSpaceAt(const std::string& path);

}  // namespace myograde::server
