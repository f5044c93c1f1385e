// myograde login, logout, whoami, token: how people are known over the network
#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <signal.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "protocol/base/status_macros.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

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
        "no token given; type it, or pass it on standard input: myograde login URL < FILE");
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
  if (role == "public") return "a member of the public, who may read public boards";
  return absl::StrCat(role.find_first_of("aeiou") == 0 ? "an " : "a ", role,
                      Filled(who, "[ of {teams}]"));
}

// A login is kept in a "file".
void PrintWho(const Json& who) {
  std::cout << Filled(who, "To {server} you are ") << RoleText(who)
            << Filled(who, " ({caller}).\n");
  const Json token = who.value("token", Json());
  if (token.is_object()) {
    std::cout << Filled(token,
                        "Your token is number {id}, \"{label}\"[, valid until {expires_at}].\n");
  }
  std::cout << Filled(who, "[The login is stored in {file}; \"myograde logout\" removes it.\n]");
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
        "a login is for a server over the network, https://HOST:PORT; a daemon on this host knows "
        "you by your user name, without a token");
  }
  ServerChoice choice = {
      .address = std::move(address), .token = "", .ca_file = CaFile(options.ca_file)};
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
        server, " ignored the token, so nothing was stored; check that it is for this server"));
  }
  RETURN_IF_ERROR(WriteLogin({.server = server, .token = token, .ca_file = target.ca_file}));
  who["file"] = LoginFile();
  return who;
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
    std::cout << "There was no login to remove." << std::endl;
    return;
  }
  std::cout << Filled(answer, "The login[ to {server}] is removed. Its token stays valid until it "
                              "expires or the organiser revokes it.")
            << std::endl;
}

struct TokenOptions : DaemonOptions {
  std::string role = "participant";
  std::string team;
  std::string label;
  std::string expires;
  int64_t days = 0;  // 0: not given
  int64_t id = 0;
};

void PrintCreated(const Json& token) {
  const bool of_team = !token.value("team", Json()).is_null();
  const std::string until = Filled(token, "[, until {expires_at}]");
  std::cout << Filled(token, of_team ? "Token {id} for team {team}" : "Token {id} for an {role}")
            << (until.empty() ? ", which does not expire" : until)
            << ". It is shown only once:" << std::endl;
  // Whole, so that it can be copied.
  PlainOutput() << Cell(token, "token") << std::endl;
  std::cout << Filled(token,
                      "Hand it over in private: anybody who has it can use it. \"myograde token "
                      "revoke {id}\" revokes it.")
            << std::endl;
}

absl::StatusOr<int> CreateToken(const TokenOptions& options) {
  Json body = {{"role", options.role}, {"label", options.label}};
  SetIfGiven(body, "team", options.team);
  SetIfGiven(body, "expires_at", options.expires);
  if (options.days != 0) body["valid_days"] = options.days;
  const Client client = options.client();
  const absl::StatusOr<Json> token = client.Post("/v1/tokens", body);
  const absl::StatusOr<int> status = PrintAnswer(token, options.json, PrintCreated);
  const int error = FlushStandardOutput();
  if (!token.ok() || error == 0) return status;
  // Nobody has seen it, so nobody should find it among those that are valid.
  const absl::Status revoked =
      client.Post(absl::StrCat("/v1/tokens/", Cell(*token, "id"), "/revoke"), Json::object())
          .status();
  return absl::InternalError(absl::StrCat(
      "token ", Cell(*token, "id"), " could not be printed (", std::strerror(error), "), so it ",
      revoked.ok() ? "is revoked; create another where its output can be written"
                   : absl::StrCat("should be revoked, which failed: ", revoked.message())));
}

}  // namespace

Command AddLogin(CLI::App& verb) {
  auto options = std::make_shared<LoginOptions>();
  verb.add_option("URL", options->url, "The server's address, https://HOST:PORT")->required();
  AddCaFile(verb, options->ca_file);
  AddJson(verb, "login", options->json);
  return [options] { return PrintAnswer(LogIn(*options), options->json, PrintWho); };
}

Command AddLogout(CLI::App& verb) {
  auto json = std::make_shared<bool>(false);
  AddJson(verb, "logout", *json);
  return [json] { return PrintAnswer(LogOut(), *json, PrintLogout); };
}

Command AddWhoami(CLI::App& verb) {
  auto options = std::make_shared<DaemonOptions>();
  AddDaemonOptions(verb, "whoami", *options);
  return [options] { return PrintAnswer(AskWho(options->client()), options->json, PrintWho); };
}

Command AddToken(CLI::App& verb) {
  DaemonParts<TokenOptions> parts(verb);
  TokenOptions& options = parts.options();
  CLI::App* create = parts.Add("create", "Create a token, which is shown only once",
                               "create --team \"Team Blue\" --label \"Ada's laptop\" --days 90",
                               "token", CreateToken);
  create
      ->add_option("--role", options.role,
                   "participant, organiser or operator (default: participant)")
      ->check(CLI::IsMember({"participant", "organiser", "operator"}));
  create->add_option("--team", options.team, "The team that a participant's token acts for");
  create->add_option("--label", options.label, "Who uses it, or where; up to 100 bytes")
      ->required();
  CLI::Option* days = create
                          ->add_option("--days", options.days,
                                       "Days that it is valid for (default: it never expires)")
                          ->check(CLI::Range(1, 3650));
  create->add_option("--expires", options.expires, "When it expires, as in 2026-12-01T00:00:00Z")
      ->excludes(days);
  parts.Add(
      "list", "List the tokens, without their "
              "secrets", "list", "tokens", [](const TokenOptions& of) {
        return of.ListAndPrint("/v1/tokens", "tokens",
                               "There are no tokens yet; create one with \"myograde token "
                               "create\".",
                               {"token=id", "role", "team", "label", "state", "made by=created_by",
                                "until=expires_at", "last used=last_used_at"});
      });
  parts
      .Add("revoke", "Revoke a token at once", "revoke 7", "token",
           [](const TokenOptions& of) {
             return of.PostAndPrint(absl::StrCat("/v1/tokens/", of.id, "/revoke"), Json::object(),
                                    Sentence("Token {id} is revoked.",
                                             "Token {id} was already revoked; nothing changed."));
           })
      ->add_option("ID", options.id, "The token")
      ->required()
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "not a token's number, as \"myograde token list\" lists them"));
  return {};
}

}  // namespace myograde::server
