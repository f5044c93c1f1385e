// Which daemon a verb speaks to, and what it shows there.
#pragma once

#include <absl/status/statusor.h>

#include <string>

#include "server/cli/client/server_address.h"

namespace myograde::server {

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

}  // namespace myograde::server
