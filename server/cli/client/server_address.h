// Where a daemon is: at a Unix socket of this host, or at a URL.
#pragma once

#include <absl/status/statusor.h>

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

}  // namespace myograde::server
