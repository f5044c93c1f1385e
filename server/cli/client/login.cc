// myograde login, logout, whoami
#include <absl/strings/str_cat.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "protocol/base/status_macros.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/login_file.h"
#include "server/cli/client/print_answer.h"
#include "server/cli/client/read_secret.h"
#include "server/cli/client/server_choice.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct LoginOptions {
  std::string url;
  std::string ca_file;
  bool json = false;
};

std::string TeamsText(const Json& who) {
  std::string text;
  for (const Json& team : who.value("teams", Json::array())) {
    if (team.is_string()) {
      absl::StrAppend(&text, text.empty() ? "" : ", ", Harmless(team.get<std::string>()));
    }
  }
  return text;
}

// "an operator", "a participant of Team Blue".
std::string RoleText(const Json& who) {
  const std::string role = Cell(who, "role");
  if (role == "public") return "one of the public, who may read public boards";
  const bool vowel = role.find_first_of("aeiou") == 0;
  const std::string teams = TeamsText(who);
  return absl::StrCat(vowel ? "an " : "a ", role, teams.empty() ? "" : " of ", teams);
}

void PrintWho(const Json& who) {
  std::cout << "To " << Cell(who, "server") << " you are " << RoleText(who) << " ("
            << Cell(who, "caller") << ").\n";
  const Json token = who.value("token", Json());
  if (token.is_object()) {
    std::cout << "Your token is number " << Cell(token, "id") << ", \"" << Cell(token, "label")
              << "\"";
    const bool ends = token.contains("expires_at") && token["expires_at"].is_string();
    std::cout << (ends ? ", valid until " + Cell(token, "expires_at") : "") << ".\n";
  }
  std::cout.flush();
}

absl::StatusOr<Json> AskWho(const Client& client) {
  absl::StatusOr<Json> who = client.Get("/v1/whoami");
  if (who.ok()) (*who)["server"] = client.where();
  return who;
}

// What the file will hold, before anybody was asked for the token.
absl::StatusOr<ServerChoice> Target(const LoginOptions& options) {
  ASSIGN_OR_RETURN(ServerAddress address, ParseServer(options.url, "URL"));
  if (!address.network()) {
    return absl::InvalidArgumentError(
        "a login is for a server over the network, https://HOST:PORT; a daemon of this host knows "
        "you by your user, without a token");
  }
  ServerChoice choice;
  choice.address = std::move(address);
  choice.ca_file = options.ca_file;
  if (const char* file = std::getenv("MYOGRADE_CA_FILE");
      choice.ca_file.empty() && file != nullptr) {
    choice.ca_file = file;
  }
  if (!choice.ca_file.empty()) choice.ca_file = std::filesystem::absolute(choice.ca_file).string();
  return choice;
}

absl::StatusOr<Json> LogIn(const LoginOptions& options) {
  ASSIGN_OR_RETURN(ServerChoice target, Target(options));
  const std::string server = target.address.Text();
  ASSIGN_OR_RETURN(std::string token, ReadSecret(absl::StrCat("Token for ", server, ": ")));
  RETURN_IF_ERROR(CheckToken(token, "standard input"));
  target.token = token;
  absl::StatusOr<Json> who = AskWho(Client(target));
  if (!who.ok()) return who;
  if (!who->value("token", Json()).is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(
        server, " takes no notice of the token, so nothing was kept; is it for another server?"));
  }
  RETURN_IF_ERROR(WriteLogin({.server = server, .token = token, .ca_file = target.ca_file}));
  (*who)["file"] = LoginFile();
  return who;
}

void PrintLogin(const Json& who) {
  PrintWho(who);
  std::cout << "The login is kept in " << Cell(who, "file")
            << "; \"myograde logout\" removes it.\n";
}

int Logout(bool json) {
  // Whatever is wrong with the file, it can be removed.
  const absl::StatusOr<std::optional<Login>> login = ReadLogin();
  const bool known = login.ok() && login->has_value();
  const absl::StatusOr<bool> removed = RemoveLogin();
  if (!removed.ok()) return ReportError(removed.status());
  if (json) {
    PrintJson({{"removed", *removed},
               {"file", LoginFile()},
               {"server", known ? Json((*login)->server) : Json()}});
  } else if (*removed) {
    std::cout << "The login" << (known ? " to " + Harmless((*login)->server) : "")
              << " is removed. Its token stays valid until it expires or the organiser revokes it."
              << std::endl;
  } else {
    std::cout << "There was no login." << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddLogin(CLI::App& verb) {
  auto options = std::make_shared<LoginOptions>();
  verb.add_option("URL", options->url, "The server's address, https://HOST:PORT")->required();
  AddCaFile(verb, options->ca_file);
  AddJson(verb, "login", options->json);
  return [options] { return PrintAnswer(LogIn(*options), options->json, PrintLogin); };
}

Action AddLogout(CLI::App& verb) {
  auto json = std::make_shared<bool>(false);
  AddJson(verb, "logout", *json);
  return [json] { return Logout(*json); };
}

Action AddWhoami(CLI::App& verb) {
  auto options = std::make_shared<DaemonOptions>();
  AddDaemonOptions(verb, "whoami", *options);
  return [options] { return PrintAnswer(AskWho(options->client()), options->json, PrintWho); };
}

}  // namespace myograde::server
