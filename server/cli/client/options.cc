// Which daemon a verb speaks to, by options, environment and login, and other options of such verbs
#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/http_client.h"
#include "server/base/ip_address.h"
#include "server/base/json_value.h"
#include "server/base/paths.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

constexpr int kHttpsPort = 443;
constexpr int kHttpPort = 80;
constexpr size_t kMaxHost = 253;

int DefaultPort(ServerAddress::Kind kind) {
  return kind == ServerAddress::Kind::kHttps ? kHttpsPort : kHttpPort;
}

bool IsHostName(const std::string& host) {
  return !host.empty() && host.size() <= kMaxHost && host.front() != '-' && host.front() != '.' &&
         std::all_of(host.begin(), host.end(), [](unsigned char c) {
           return absl::ascii_isalnum(c) || c == '-' || c == '.';
         });
}

// Host and port of what stands behind "https://". False: it is no such thing.
bool ReadAuthority(std::string text, ServerAddress& address) {
  if (text.ends_with('/')) text.pop_back();
  address.port = DefaultPort(address.kind);
  const size_t bracket = text.rfind(']');
  const size_t colon = text.find(':', bracket == std::string::npos ? 0 : bracket);
  if (colon != std::string::npos) {
    const std::string port = text.substr(colon + 1);
    const bool digits = !port.empty() && port.size() <= 5 &&
                        port.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || !absl::SimpleAtoi(port, &address.port)) return false;
    if (address.port < 1 || address.port > 65535) return false;
    text.resize(colon);
  }
  if (text.starts_with('[')) {
    if (!text.ends_with(']')) return false;
    address.host = text.substr(1, text.size() - 2);
    return address.host.find(':') != std::string::npos &&
           IpAddress::Parse(address.host).has_value();
  }
  address.host = absl::AsciiStrToLower(text);
  return IsHostName(address.host);
}

// The choice without what is shown there.
absl::StatusOr<ServerChoice> ChooseAddress(const ServerOptions& options) {
  ServerChoice choice;
  const std::string variable = EnvironmentVariable("MYOGRADE_SERVER");
  const bool names_socket = !options.socket.empty() || !options.data.empty();
  if (!options.server.empty()) {
    ASSIGN_OR_RETURN(choice.address, ParseServer(options.server, "--server"));
    return choice;
  }
  if (!names_socket && !variable.empty()) {
    ASSIGN_OR_RETURN(choice.address, ParseServer(variable, "MYOGRADE_SERVER"));
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

constexpr size_t kMaxFile = 64 << 10;
constexpr size_t kMaxToken = 512;

std::string HomeDir() {
  if (std::string home = EnvironmentVariable("HOME"); !home.empty()) return home;
  const passwd* user = ::getpwuid(::getuid());
  return user == nullptr ? "/" : user->pw_dir;
}

absl::Status NotUsable(const std::string& path, std::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": ",
                                                 absl::string_view(why.data(), why.size()),
                                                 "; replace it with \"myograde login\", or remove "
                                                 "it with \"myograde logout\""));
}

// The token is as good as its owner's only while nobody else knows it.
absl::Status CheckRights(const std::string& path, int fd) {
  struct stat info;
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return NotUsable(path, "is not a file");
  if (info.st_uid != ::geteuid()) return NotUsable(path, "belongs to another user");
  if ((info.st_mode & 077) == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      path,
      ": other users may read the token in it; withdraw that right (chmod 600), and have the "
      "token replaced if somebody may have read it"));
}

}  // namespace

std::string ServerAddress::Text() const {
  if (!network()) return socket;
  const std::optional<IpAddress> numeric = IpAddress::Parse(host);
  std::string text = absl::StrCat(kind == Kind::kHttps ? "https://" : "http://",
                                  numeric.has_value() ? numeric->UrlHost() : host);
  if (port != DefaultPort(kind)) absl::StrAppend(&text, ":", port);
  return text;
}

absl::StatusOr<ServerAddress> ParseServer(const std::string& text, const std::string& what) {
  ServerAddress address;
  if (text.starts_with("unix:") && text.size() > 5) {
    address.socket = text.substr(5);
    return address;
  }
  const size_t scheme = text.find("://");
  if (scheme == std::string::npos && text.find('/') != std::string::npos) {
    address.socket = text;
    return address;
  }
  if (text.find('@') != std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": leave user and password out of the address; \"myograde login\" takes a token"));
  }
  const std::string word =
      absl::AsciiStrToLower(text.substr(0, scheme == std::string::npos ? 0 : scheme));
  address.kind = word == "https" ? ServerAddress::Kind::kHttps : ServerAddress::Kind::kHttp;
  if ((word != "https" && word != "http") || !ReadAuthority(text.substr(scheme + 3), address)) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": \"", CutText(Sanitized(text), 80),
        "\" is not a server's address: write https://HOST:PORT, or the path of a daemon's socket"));
  }
  const std::optional<IpAddress> numeric = IpAddress::Parse(address.host);
  const bool here = address.host == "localhost" || (numeric.has_value() && numeric->IsLoopback());
  if (address.kind == ServerAddress::Kind::kHttp && !here) {
    return absl::InvalidArgumentError(absl::StrCat(
        what, ": ", address.Text(),
        " is without TLS, so anybody on the network could read and change everything; write "
        "https://, or for this host http://127.0.0.1"));
  }
  return address;
}

std::string CaFile(const std::string& option) {
  return option.empty() ? EnvironmentVariable("MYOGRADE_CA_FILE") : option;
}

absl::StatusOr<ServerChoice> ChooseServer(const ServerOptions& options) {
  ASSIGN_OR_RETURN(ServerChoice choice, ChooseAddress(options));
  choice.ca_file = CaFile(options.ca_file);
  if (const std::string token = EnvironmentVariable("MYOGRADE_TOKEN"); !token.empty()) {
    RETURN_IF_ERROR(CheckToken(token, "MYOGRADE_TOKEN"));
    // For the server that MYOGRADE_SERVER names, if it names one.
    const std::string variable = EnvironmentVariable("MYOGRADE_SERVER");
    ServerAddress named = choice.address;
    if (!variable.empty()) {
      ASSIGN_OR_RETURN(named, ParseServer(variable, "MYOGRADE_SERVER"));
    }
    if (named.Text() == choice.address.Text()) choice.token = token;
  }
  if (!choice.address.network() || (!choice.token.empty() && !choice.ca_file.empty())) {
    return choice;
  }
  ASSIGN_OR_RETURN(const std::optional<Login> login, ReadLogin());
  if (login.has_value() && login->server == choice.address.Text()) {
    if (choice.token.empty()) choice.token = login->token;
    if (choice.ca_file.empty()) choice.ca_file = login->ca_file;
  }
  return choice;
}

std::string LoginFile() {
  const std::string configs = EnvironmentVariable("XDG_CONFIG_HOME");
  // The XDG specification has relative paths ignored.
  return absl::StrCat(configs.starts_with('/') ? configs : HomeDir() + "/.config",
                      "/myograde/login.json");
}

absl::Status CheckToken(const std::string& token, const std::string& what) {
  const bool good =
      !token.empty() && token.size() <= kMaxToken &&
      std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < 0x7f; });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(what, ": not a token, which is one word of at most ", kMaxToken,
                   " letters, digits and punctuation marks, as the organiser gave it to you"));
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
  const Json json = ParsedText(*text);
  ConfigReader reader(json, path);
  Login login{.server = reader.String("server"), .token = reader.String("token"), .ca_file = ""};
  if (reader.Has("ca_file") && !json["ca_file"].is_null()) login.ca_file = reader.String("ca_file");
  if (!reader.Finish().ok()) return NotUsable(path, "is not a login");
  RETURN_IF_ERROR(CheckToken(login.token, path));
  return login;
}

absl::Status WriteLogin(const Login& login) {
  const std::string path = LoginFile();
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  std::filesystem::create_directories(folder.parent_path(), error);
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) return CantWrite(folder.string());
  const Json json = {
      {"server", login.server}, {"token", login.token}, {"ca_file", TextOrNull(login.ca_file)}};
  return WriteNewFile(path, json.dump(2) + "\n").status();
}

absl::StatusOr<bool> RemoveLogin() {
  const std::string path = LoginFile();
  if (::unlink(path.c_str()) == 0) return true;
  if (errno == ENOENT || errno == ENOTDIR) return false;
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": can't be removed (", std::strerror(errno), ")"));
}

std::string BuildQuery(const std::vector<std::pair<const char*, std::string>>& values) {
  std::string query;
  for (const auto& [key, value] : values) {
    if (value.empty()) continue;
    absl::StrAppend(&query, query.empty() ? "?" : "&", key, "=", QueryValue(value));
  }
  return query;
}

void SetIfGiven(Json& body, const char* key, const std::string& value) {
  if (!value.empty()) body[key] = value;
}

Client DaemonOptions::client() const { return Client(ChooseServer(*this)); }

absl::StatusOr<int> DaemonOptions::GetAndPrint(const std::string& path,
                                               const AnswerPrinter& print) const {
  return PrintAnswer(client().Get(path), json, print);
}

absl::StatusOr<int> DaemonOptions::PostAndPrint(const std::string& path, const Json& body,
                                                const AnswerPrinter& print) const {
  return PrintAnswer(client().Post(path, body), json, print);
}

absl::StatusOr<int> DaemonOptions::ListAndPrint(const std::string& path, const std::string& rows,
                                                const std::string& none,
                                                const std::vector<RowColumn>& columns) const {
  return PrintAnswer(GetAllPages(client(), path, rows), json, [&](const Json& answer) {
    PrintList(answer, rows, none, columns);
  });
}

void AddCaFile(CLI::App& verb, std::string& file) {
  verb.add_option("--ca-file", file,
                  "PEM file of the authorities to trust for the server's certificate (default: "
                  "MYOGRADE_CA_FILE, else the login's, else those that this host trusts)");
}

void AddDaemonOptions(CLI::App& verb, const std::string& schema, DaemonOptions& options,
                      const std::string& json_help) {
  AddJson(verb, schema, options.json, json_help);
  AddPlaces(verb, options);
}

void AddPlaces(CLI::App& verb, DaemonOptions& options) {
  CLI::Option* data = verb.add_option(
      "--data", options.data,
      "Data folder of the daemon (default: MYOGRADE_DATA, else /var/lib/myograde for root and "
      "~/.local/share/myograde for others)");
  CLI::Option* socket = verb.add_option("--socket", options.socket,
                                        "The daemon's socket (default: DATA/myograde.sock)");
  verb.add_option("--server", options.server,
                  "The daemon's address, https://HOST:PORT (default: MYOGRADE_SERVER, else the "
                  "daemon of --data, else the server of \"myograde login\")")
      ->excludes(data)
      ->excludes(socket);
  AddCaFile(verb, options.ca_file);
}

std::string BoardChoice::Query() const {
  return BuildQuery({{"track", track},
                     {"board", board},
                     {"phase", phase},
                     {"profile", profile},
                     {"config", config},
                     {"at", at}});
}

void AddBoardChoice(CLI::App& verb, BoardChoice& choice, const std::string& track_help,
                    const std::string& phase_help) {
  verb.add_option("--track", choice.track, track_help);
  verb.add_option("--phase", choice.phase, phase_help);
  verb.add_option("--profile", choice.profile, "Rules profile (default: the track's own)");
  verb.add_option("--board", choice.board,
                  "Name of the board (default: main, which every track has)");
  verb.add_option("--config", choice.config,
                  "The board under its present config or an earlier one: the config's hash, or at "
                  "least the first 8 digits of it");
}

std::string SubmissionOptions::Resource(const std::string& part) const {
  return absl::StrCat("/v1/submissions/", id, part);
}

void AddSubmissionId(CLI::App& verb, SubmissionOptions& options, bool required,
                     const std::string& help) {
  verb.add_option("ID", options.id, help)
      ->required(required)
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "not a submission's number, as \"myograde status\" lists them"));
}

}  // namespace myograde::server
