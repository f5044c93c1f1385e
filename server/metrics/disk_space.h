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

// "" if the disk of `data_dir` has `reserve` bytes free; else a sentence with what to do.
std::string LackOfRoom(const std::string& data_dir, int64_t reserve);

}  // namespace myograde::server
