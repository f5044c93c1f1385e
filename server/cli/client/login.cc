// myograde login, logout, whoami
#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <signal.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/server_choice.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxLine = 4096;

termios g_terminal;  // as it was

void ShowAgain() { ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &g_terminal); }

void OnInterrupt(int signal) {
  ShowAgain();
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

// While it lives, a terminal at standard input does not show what is typed. A signal that ends the
// program ends that too.
class Hidden {
 public:
  Hidden() : terminal_(::tcgetattr(STDIN_FILENO, &g_terminal) == 0) {
    if (!terminal_) return;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) ::signal(signal, OnInterrupt);
    termios hidden = g_terminal;
    hidden.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &hidden);
  }
  ~Hidden() {
    if (!terminal_) return;
    ShowAgain();
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) ::signal(signal, SIG_DFL);
    std::cerr << std::endl;  // the one that was typed was not shown
  }
  Hidden(const Hidden&) = delete;
  Hidden& operator=(const Hidden&) = delete;

 private:
  const bool terminal_;
};

// One line of standard input: on a terminal after `prompt` and without showing what is typed.
// InvalidArgumentError: there is none.
absl::StatusOr<std::string> ReadSecret(const std::string& prompt) {
  const Hidden hidden;  // before anything is typed; what was typed before is dropped
  if (::isatty(STDIN_FILENO) == 1) std::cerr << prompt << std::flush;
  std::string line;
  for (char byte = 0; line.size() < kMaxLine;) {
    const ssize_t n = ::read(STDIN_FILENO, &byte, 1);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0 || byte == '\n') break;
    line += byte;
  }
  absl::StripAsciiWhitespace(&line);
  if (line.empty()) {
    return absl::InvalidArgumentError(
        "no token was given; type it, or have it on standard input: myograde login URL < FILE");
  }
  return line;
}

struct LoginOptions {
  std::string url;
  std::string ca_file;
  bool json = false;
};

// "an operator", "a participant of Team Blue".
std::string RoleText(const Json& who) {
  const std::string role = Cell(who, "role");
  if (role == "public") return "one of the public, who may read public boards";
  const bool vowel = role.find_first_of("aeiou") == 0;
  const std::string teams = ListCell(who, "teams");
  return absl::StrCat(vowel ? "an " : "a ", role, teams == "-" ? "" : " of " + teams);
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
  ServerChoice choice = {.address = std::move(address), .token = "", .ca_file = ""};
  choice.ca_file = options.ca_file.empty() ? EnvironmentVariable("MYOGRADE_CA_FILE") : options.ca_file;
  if (!choice.ca_file.empty()) choice.ca_file = std::filesystem::absolute(choice.ca_file).string();
  return choice;
}

absl::StatusOr<Json> LogIn(const LoginOptions& options) {
  ASSIGN_OR_RETURN(ServerChoice target, Target(options));
  const std::string server = target.address.Text();
  ASSIGN_OR_RETURN(std::string token, ReadSecret(absl::StrCat("Token for ", server, ": ")));
  RETURN_IF_ERROR(CheckToken(token, "standard input"));
  target.token = token;
  ASSIGN_OR_RETURN(Json who, AskWho(Client(target)));
  if (!who.value("token", Json()).is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(
        server, " takes no notice of the token, so nothing was kept; is it for another server?"));
  }
  RETURN_IF_ERROR(WriteLogin({.server = server, .token = token, .ca_file = target.ca_file}));
  who["file"] = LoginFile();
  return who;
}

void PrintLogin(const Json& who) {
  PrintWho(who);
  std::cout << "The login is kept in " << Cell(who, "file")
            << "; \"myograde logout\" removes it.\n";
}

absl::StatusOr<Json> LogOut() {
  // Whatever is wrong with the file, it can be removed.
  const absl::StatusOr<std::optional<Login>> login = ReadLogin();
  const bool known = login.ok() && login->has_value();
  ASSIGN_OR_RETURN(const bool removed, RemoveLogin());
  return Json{{"removed", removed},
              {"file", LoginFile()},
              {"server", known ? Json((*login)->server) : Json()}};
}

void PrintLogout(const Json& answer) {
  if (!answer["removed"]) {
    std::cout << "There was no login." << std::endl;
    return;
  }
  std::cout << "The login" << (answer["server"].is_null() ? "" : " to " + Cell(answer, "server"))
            << " is removed. Its token stays valid until it expires or the organiser revokes it."
            << std::endl;
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
  return [json] { return PrintAnswer(LogOut(), *json, PrintLogout); };
}

Action AddWhoami(CLI::App& verb) {
  auto options = std::make_shared<DaemonOptions>();
  AddDaemonOptions(verb, "whoami", *options);
  return [options] { return PrintAnswer(AskWho(options->client()), options->json, PrintWho); };
}

}  // namespace myograde::server
