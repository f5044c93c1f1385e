#include "server/cli/base/places.h"

#include <filesystem>

#include "server/base/paths.h"

namespace myograde::server {
namespace {

// Of the daemon that a package's units start.
constexpr char kSystemSocket[] = "/run/myograde/myograde.sock";

}  // namespace

std::string DataDir(const std::string& option) {
  if (!option.empty()) return option;
  if (const std::string folder = EnvironmentVariable("MYOGRADE_DATA"); !folder.empty())
    return folder;
  return UsualDataDir();
}

std::string CacheDir(const std::string& option) {
  if (!option.empty()) return std::filesystem::absolute(option).string();
  if (const std::string folder = EnvironmentVariable("MYOGRADE_CACHE"); !folder.empty()) {
    return std::filesystem::absolute(folder).string();
  }
  return UsualCacheDir();
}

std::string SocketPath(const std::string& socket_option, const std::string& data_option) {
  if (!socket_option.empty()) return socket_option;
  const std::string own = DataDir(data_option) + "/myograde.sock";
  const bool named = !data_option.empty() || !EnvironmentVariable("MYOGRADE_DATA").empty();
  std::error_code error;
  if (named || std::filesystem::exists(own, error)) return own;
  return std::filesystem::exists(kSystemSocket, error) ? kSystemSocket : own;
}

}  // namespace myograde::server
