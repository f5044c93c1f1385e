#include "server/metrics/disk_space.h"

#include <sys/statvfs.h>

#include <absl/strings/str_cat.h>

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

std::string LackOfRoom(const std::string& data_dir, int64_t reserve) {
  const std::optional<DiskSpace> disk = DiskSpaceAt(data_dir);
  if (!disk.has_value()) return absl::StrCat(data_dir, ": its disk can't be looked at");
  if (disk->free >= reserve) return "";
  return absl::StrCat("the disk of ", data_dir, " has ", disk->free, " bytes free, and uploads and ",
                      "leases must leave ", reserve,
                      " (disk_reserve_bytes): make room; it goes on by itself");
}

}  // namespace myograde::server
