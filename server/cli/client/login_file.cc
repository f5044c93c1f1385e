#include "server/cli/client/login_file.h"

#include <absl/strings/str_cat.h>
#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/cli/base/new_file.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxFile = 64 << 10;
constexpr size_t kMaxToken = 512;

std::string HomeOf() {
  if (const char* home = std::getenv("HOME"); home != nullptr && *home != '\0') return home;
  const passwd* user = ::getpwuid(::getuid());
  return user == nullptr ? "/" : user->pw_dir;
}

absl::Status NotUsable(const std::string& path, std::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": ",
                                                 absl::string_view(why.data(), why.size()),
                                                 "; \"myograde login\" writes it anew, \"myograde "
                                                 "logout\" removes it"));
}

// The token is as good as its owner's only while nobody else knows it.
absl::Status CheckRights(const std::string& path, int fd) {
  struct stat info;
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return NotUsable(path, "is no file");
  if (info.st_uid != ::geteuid()) return NotUsable(path, "belongs to another user");
  if ((info.st_mode & 077) == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      path,
      ": other users may read the token in it; take that right away (chmod 600), and have the "
      "token replaced if they may have done so"));
}

}  // namespace

std::string LoginFile() {
  const char* configs = std::getenv("XDG_CONFIG_HOME");
  // The XDG specification has relative paths ignored.
  const bool given = configs != nullptr && *configs == '/';
  return absl::StrCat(given ? configs : HomeOf() + "/.config", "/myograde/login.json");
}

absl::Status CheckToken(const std::string& token, const std::string& what) {
  const bool good =
      !token.empty() && token.size() <= kMaxToken &&
      std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < 0x7f; });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(what, ": this is no token; it is one word of at most ", kMaxToken,
                   " letters, digits and signs, "
                   "as the organiser gave it"));
}

absl::StatusOr<std::optional<Login>> ReadLogin() {
  const std::string path = LoginFile();
  const Fd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) {
    if (errno == ENOENT || errno == ENOTDIR) return std::nullopt;
    return NotUsable(path, absl::StrCat("can't be read (", std::strerror(errno), ")"));
  }
  RETURN_IF_ERROR(CheckRights(path, fd.get()));
  const absl::StatusOr<std::string> text = ReadAll(fd.get(), path, kMaxFile);
  if (!text.ok()) return NotUsable(path, "can't be read");
  // An error of the parser could quote the token.
  const nlohmann::json json = nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false);
  ConfigReader reader(json, path);
  Login login{.server = reader.String("server"), .token = reader.String("token"), .ca_file = ""};
  if (reader.Has("ca_file") && !json["ca_file"].is_null()) login.ca_file = reader.String("ca_file");
  if (!reader.Finish().ok()) return NotUsable(path, "is no login");
  RETURN_IF_ERROR(CheckToken(login.token, path));
  return login;
}

absl::Status WriteLogin(const Login& login) {
  const std::string path = LoginFile();
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  std::filesystem::create_directories(folder.parent_path(), error);
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) return CantWrite(folder.string());
  NewFile file(path);
  const nlohmann::json json = {
      {"server", login.server},
      {"token", login.token},
      {"ca_file", login.ca_file.empty() ? nlohmann::json() : nlohmann::json(login.ca_file)}};
  if (!file.opened()) return CantWrite(path);
  if (!file.Write(json.dump(2) + "\n")) {
    errno = file.error();
    return CantWrite(path);
  }
  return file.Keep().status();
}

absl::StatusOr<bool> RemoveLogin() {
  const std::string path = LoginFile();
  if (::unlink(path.c_str()) == 0) return true;
  if (errno == ENOENT || errno == ENOTDIR) return false;
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": can't be removed (", std::strerror(errno), ")"));
}

}  // namespace myograde::server
