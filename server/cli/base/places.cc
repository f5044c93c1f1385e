#include "server/cli/base/places.h"

#include <cstdlib>
#include <filesystem>

#include "server/base/paths.h"

namespace myograde::server {
namespace {

std::string Environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

std::string DataDir(const std::string& option) {
  if (!option.empty()) return option;
  if (const std::string folder = Environment("MYOGRADE_DATA"); !folder.empty()) return folder;
  return UsualDataDir();
}

std::string CacheDir(const std::string& option) {
  if (!option.empty()) return std::filesystem::absolute(option).string();
  if (const std::string folder = Environment("MYOGRADE_CACHE"); !folder.empty()) {
    return std::filesystem::absolute(folder).string();
  }
  return UsualCacheDir();
}

std::string SocketPath(const std::string& socket_option, const std::string& data_option) {
  return socket_option.empty() ? DataDir(data_option) + "/myograde.sock" : socket_option;
}

}  // namespace myograde::server
