#include "server/paths.h"

#include <limits.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include <absl/strings/str_cat.h>

namespace myograde::server {

absl::StatusOr<std::string> BinDir() {
  if (const char* dir = std::getenv("MYOGRADE_BIN_DIR"); dir != nullptr && *dir != '\0') {
    return std::string(dir);
  }
  char path[PATH_MAX];
  const ssize_t length = ::readlink("/proc/self/exe", path, sizeof(path));
  if (length <= 0 || length >= static_cast<ssize_t>(sizeof(path))) {
    return absl::InternalError(
        absl::StrCat("can't tell where the running program lies: ", std::strerror(errno)));
  }
  const std::string program(path, static_cast<size_t>(length));
  return program.substr(0, program.rfind('/'));
}

std::string ConfigDir() {
  if (const char* dir = std::getenv("MYOGRADE_CONFIG_DIR"); dir != nullptr && *dir != '\0') {
    return dir;
  }
  if (absl::StatusOr<std::string> bin_dir = BinDir(); bin_dir.ok()) {
    const std::string installed = *bin_dir + "/../share/myograde/configs";
    if (::access(installed.c_str(), R_OK) == 0) return installed;
  }
  return MYOGRADE_SOURCE_CONFIG_DIR;
}

}  // namespace myograde::server
