// Which daemon a verb speaks to, what it shows there, and the login that is kept for that.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <optional>
#include <string>

namespace myograde::server {

struct ServerAddress {
  enum class Kind { kSocket, kHttp, kHttps };
  Kind kind = Kind::kSocket;
  std::string socket;  // its path; of kSocket alone
  std::string host;    // a name in lower case, or a numeric address without brackets
  int port = 0;

  bool network() const { return kind != Kind::kSocket; }
  // The path, or the URL in the one form that all spellings of it have: two addresses are of one
  // server if they have one text.
  std::string Text() const;
};

// "https://host:8443", "http://127.0.0.1:8080", "unix:PATH", or a path with a slash in it. Plain
// HTTP is for this host alone. InvalidArgumentError: one sentence that begins with `what`, which
// gave the text; the text is left out if it may hold a password.
absl::StatusOr<ServerAddress> ParseServer(const std::string& text, const std::string& what);

// The values of the options, "" if not given.
struct ServerOptions {
  std::string server;
  std::string ca_file;
  std::string data;
  std::string socket;
};

struct ServerChoice {
  ServerAddress address;
  std::string token;      // "": none
  std::string ca_file;    // "": those that this host trusts
  bool by_login = false;  // nothing but the login chose it
};

// README.md has the order: --server, --socket and --data; MYOGRADE_SERVER; MYOGRADE_DATA; the
// login; the default data folder. A token goes to the server that it belongs to and to no other.
// InvalidArgumentError: an address, the login or a token can't be used.
absl::StatusOr<ServerChoice> ChooseServer(const ServerOptions& options);

// The value of --ca-file, else of MYOGRADE_CA_FILE.
std::string CaFile(const std::string& option);

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
