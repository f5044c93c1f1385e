#include "server/base/paths.h"

#include <pwd.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// Where a package has the programs that people don't call themselves, below its prefix.
constexpr char kPrograms[] = "libexec/myograde";
constexpr char kSystemCache[] = "/var/cache/myograde";

std::string DefaultDir(const char* of_root, const char* variable, const char* in_home) {
  if (::geteuid() == 0) return of_root;
  // The XDG specification says to ignore relative paths.
  const std::string folder = EnvironmentVariable(variable);
  if (folder.starts_with('/')) return folder + "/myograde";
  std::string home = EnvironmentVariable("HOME");
  if (!home.starts_with('/')) {
    // As for a job of a cluster, which has no environment.
    const passwd* self = ::getpwuid(::geteuid());
    home = self != nullptr ? self->pw_dir : "";
  }
  return absl::StrCat(home, "/", in_home, "/myograde");
}

// The folder of the running program.
absl::StatusOr<std::string> OwnDir() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) return program.parent_path();
  return absl::InternalError(
      absl::StrCat("can't tell where the running program lies: ", error.message()));
}

// `folder` of an installation that has its programs in `bin_dir` if it is there, else the one
// beside `bin_dir` (a build's).
std::string InstalledOrBuilt(const std::string& bin_dir, const std::string& folder) {
  const std::string installed = absl::StrCat(ShareDir(bin_dir), "/", folder);
  std::error_code error;
  if (fs::is_directory(installed, error)) return installed;
  return fs::path(bin_dir).parent_path() / folder;
}

}  // namespace

std::string EnvironmentVariable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::string DefaultDataDir() {
  return DefaultDir("/var/lib/myograde", "XDG_DATA_HOME", ".local/share");
}

std::string OwnCacheDir() { return DefaultDir(kSystemCache, "XDG_CACHE_HOME", ".cache"); }

std::string DefaultCacheDir() { return CacheDirOf(OwnCacheDir(), kSystemCache); }

std::string CacheDirOf(const std::string& own, const std::string& system) {
  const auto has_models = [](const std::string& folder) {
    return ::access((folder + "/models").c_str(), R_OK | X_OK) == 0;
  };
  return !has_models(own) && has_models(system) ? system : own;
}

absl::StatusOr<std::string> BinDir() {
  if (std::string dir = EnvironmentVariable("MYOGRADE_BIN_DIR"); !dir.empty()) return dir;
  ASSIGN_OR_RETURN(const std::string own_dir, OwnDir());
  const std::string apart = fs::path(own_dir).parent_path() / kPrograms;
  return ::access((apart + "/myograde-runner").c_str(), X_OK) == 0 ? apart : own_dir;
}

std::string ShareDir(const std::string& bin_dir) {
  const fs::path folder = fs::path(bin_dir).lexically_normal();
  fs::path prefix = folder.parent_path();
  if (prefix / folder.filename() == prefix.parent_path() / kPrograms) prefix = prefix.parent_path();
  return prefix / "share/myograde";
}

std::string AdapterFolder(const std::string& adapter, const std::string& bin_dir) {
  return InstalledOrBuilt(bin_dir, "adapters/" + adapter);
}

std::string ShareDir() {
  const absl::StatusOr<std::string> bin_dir = BinDir();
  const absl::StatusOr<std::string> own_dir = OwnDir();
  std::string share = bin_dir.ok() ? ShareDir(*bin_dir) : "";
  if (own_dir.ok() && ::access(share.c_str(), R_OK) != 0) share = ShareDir(*own_dir);
  return share;
}

std::string DocsDir() {
  if (std::string dir = EnvironmentVariable("MYOGRADE_DOCS_DIR"); !dir.empty()) return dir;
  const absl::StatusOr<std::string> bin_dir = BinDir();
  return bin_dir.ok() ? InstalledOrBuilt(*bin_dir, "docs") : "";
}

std::string ConfigDir() {
  if (std::string dir = EnvironmentVariable("MYOGRADE_CONFIG_DIR"); !dir.empty()) return dir;
  return ShareDir() + "/configs";
}

}  // namespace myograde::server
