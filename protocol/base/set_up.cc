#include "protocol/base/set_up.h"

#include <unistd.h>

#include <filesystem>
#include <system_error>

namespace myograde {
namespace {

constexpr char kPackagesSetUp[] = "/usr/sbin/myograde-setup";

}  // namespace

bool IsInstalled(const std::string& program) {
  std::error_code error;
  const auto build = std::filesystem::path(program).parent_path().parent_path();
  return !std::filesystem::exists(build / "CMakeCache.txt", error);
}

std::string SetUpAdvice() {
  std::error_code error;
  const std::string program = std::filesystem::read_symlink("/proc/self/exe", error);
  return ::access(kPackagesSetUp, F_OK) == 0 && IsInstalled(program) ? "run myograde-setup as root"
                                                                     : "run ./dev setup";
}

}  // namespace myograde
