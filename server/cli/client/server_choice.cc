#include "server/cli/client/server_choice.h"

#include <optional>

#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/cli/base/places.h"
#include "server/cli/client/login_file.h"

namespace myograde::server {
namespace {

// The choice without what is shown there.
absl::StatusOr<ServerChoice> ChooseAddress(const ServerOptions& options) {
  ServerChoice choice;
  const std::string variable = EnvironmentVariable("MYOGRADE_SERVER");
  const bool names_socket = !options.socket.empty() || !options.data.empty();
  if (!options.server.empty() || (!names_socket && !variable.empty())) {
    absl::StatusOr<ServerAddress> address = options.server.empty()
                                                ? ParseServer(variable, "MYOGRADE_SERVER")
                                                : ParseServer(options.server, "--server");
    if (!address.ok()) return address.status();
    choice.address = *std::move(address);
    return choice;
  }
  if (!names_socket && EnvironmentVariable("MYOGRADE_DATA").empty()) {
    ASSIGN_OR_RETURN(const std::optional<Login> login, ReadLogin());
    if (login.has_value()) {
      ASSIGN_OR_RETURN(choice.address, ParseServer(login->server, LoginFile()));
      choice.by_login = true;
      return choice;
    }
  }
  choice.address.socket = SocketPath(options.socket, options.data);
  return choice;
}

// MYOGRADE_TOKEN is for the server that MYOGRADE_SERVER names, if it names one.
absl::StatusOr<bool> IsForVariable(const ServerAddress& address) {
  const std::string variable = EnvironmentVariable("MYOGRADE_SERVER");
  if (variable.empty()) return true;
  ASSIGN_OR_RETURN(const ServerAddress named, ParseServer(variable, "MYOGRADE_SERVER"));
  return named.Text() == address.Text();
}

}  // namespace

absl::StatusOr<ServerChoice> ChooseServer(const ServerOptions& options) {
  absl::StatusOr<ServerChoice> choice = ChooseAddress(options);
  if (!choice.ok()) return choice;
  choice->ca_file =
      options.ca_file.empty() ? EnvironmentVariable("MYOGRADE_CA_FILE") : options.ca_file;
  if (const std::string token = EnvironmentVariable("MYOGRADE_TOKEN"); !token.empty()) {
    RETURN_IF_ERROR(CheckToken(token, "MYOGRADE_TOKEN"));
    ASSIGN_OR_RETURN(const bool its_own, IsForVariable(choice->address));
    if (its_own) choice->token = token;
  }
  if (!choice->address.network() || (!choice->token.empty() && !choice->ca_file.empty())) {
    return choice;
  }
  ASSIGN_OR_RETURN(const std::optional<Login> login, ReadLogin());
  if (login.has_value() && login->server == choice->address.Text()) {
    if (choice->token.empty()) choice->token = login->token;
    if (choice->ca_file.empty()) choice->ca_file = login->ca_file;
  }
  return choice;
}

}  // namespace myograde::server
