// The login that `myograde login` keeps for the verbs after it.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <optional>
#include <string>

namespace myograde::server {

struct Login {
  std::string server;  // ServerAddress::Text
  std::string token;
  std::string ca_file;  // "": those that this host trusts
};

// $XDG_CONFIG_HOME/myograde/login.json, or the same below ~/.config.
std::string LoginFile();

// nullopt: there is none. InvalidArgumentError: it can't be read, is no login, or others than this
// user may read or change it.
absl::StatusOr<std::optional<Login>> ReadLogin();

// Keeps `login` in a new file that only this user can read, in place of any other.
absl::Status WriteLogin(const Login& login);

// False: there was none.
absl::StatusOr<bool> RemoveLogin();

// OkStatus() if `token` can be sent as one. The error tells nothing of it.
absl::Status CheckToken(const std::string& token, const std::string& what);

}  // namespace myograde::server
