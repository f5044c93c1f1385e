#include "server/metrics/disk_space.h"

#include <sys/statvfs.h>

namespace myograde::server {

std::optional<DiskSpace> DiskSpaceAt(const std::string& path) {
  struct statvfs info;
  if (statvfs(path.c_str(), &info) != 0) return std::nullopt;
  const auto unit = static_cast<int64_t>(info.f_frsize);
  const auto blocks = static_cast<int64_t>(info.f_blocks);
  const auto left = static_cast<int64_t>(info.f_bfree);
  const auto ours = static_cast<int64_t>(info.f_bavail);
  return DiskSpace{blocks * unit, (blocks - left) * unit, ours * unit};
}

}  // namespace myograde::server
