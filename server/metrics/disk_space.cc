#include "server/metrics/disk_space.h"

#include <filesystem>
#include <system_error>

#include <absl/strings/str_cat.h>

namespace myograde::server {

std::optional<DiskSpace> DiskSpaceAt(const std::string& path) {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(path, error);
  if (error) return std::nullopt;
  return DiskSpace{static_cast<int64_t>(space.capacity),
                   static_cast<int64_t>(space.capacity - space.free),
                   static_cast<int64_t>(space.available)};
}

std::string LackOfRoom(const std::string& data_dir, int64_t reserve) {
  const std::optional<DiskSpace> disk = DiskSpaceAt(data_dir);
  if (!disk.has_value()) return absl::StrCat(data_dir, ": its disk can't be looked at");
  if (disk->free >= reserve) return "";
  return absl::StrCat("the disk of ", data_dir, " has ", disk->free,
                      " bytes free, and uploads and ", "leases must leave ", reserve,
                      " (disk_reserve_bytes): make room; it goes on by itself");
}

}  // namespace myograde::server
