// The daemon: which one a verb speaks to and what it shows there, its HTTP API
// (server/api/README.md) over its Unix socket or the network, what several verbs ask of it, and
// their options.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/log/episode_log.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {

struct ServerAddress {
  enum class Kind { kSocket, kHttp, kHttps };
  Kind kind = Kind::kSocket;
  std::string socket;  // its path; only of kSocket
  std::string host;    // a name in lower case, or a numeric address without brackets
  int port = 0;

  bool network() const { return kind != Kind::kSocket; }
  // The path, or the URL in the one form that all spellings of it have: two addresses are of one
  // server if they have one text.
  std::string Text() const;
};

// "https://host:8443", "http://127.0.0.1:8080", "unix:PATH", or a path with a slash in it. Plain
// HTTP is only for this host. InvalidArgumentError: one sentence that begins with `what`, which
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

// nullopt: there is none. InvalidArgumentError: it can't be read, is not a login, or others than this
// user may read or change it.
absl::StatusOr<std::optional<Login>> ReadLogin();

// Keeps `login` in a new file that only this user can read, in place of any other.
absl::Status WriteLogin(const Login& login);

// False: there was none.
absl::StatusOr<bool> RemoveLogin();

// OkStatus() if `token` can be sent as one. The error does not quote it.
absl::Status CheckToken(const std::string& token, const std::string& what);

// One connection for each request. Errors: UnavailableError if no daemon
// answers in time, InvalidArgumentError with the daemon's sentence if it
// refuses the request, InternalError if the daemon is in trouble.
class Client {
 public:
  // An error is that of every request.
  explicit Client(absl::StatusOr<ServerChoice> choice);

  // Where requests go, as people write it; "" if there is no such place.
  std::string where() const { return choice_.ok() ? choice_->address.Text() : ""; }

  absl::StatusOr<Json> Get(const std::string& path) const;
  // `once`, for what must be done once: the request has an Idempotency-Key of its own, and is sent
  // once more if its answer is lost.
  absl::StatusOr<Json> Post(const std::string& path, const Json& body, bool once = false) const;

  // Sends `file`, whose content is of `type`; `progress` is called with the bytes
  // sent so far and in total.
  absl::StatusOr<Json> Upload(const std::string& path, const std::string& file,
                              const std::function<void(int64_t done, int64_t total)>& progress,
                              const std::string& type = "application/x-tar") const;

  // Passes the answer's bytes to `sink` piece by piece, and returns their number; an error of the
  // sink ends it. Little of the answer is in memory at a time.
  absl::StatusOr<int64_t> Download(
      const std::string& path, const std::function<absl::Status(std::string_view)>& sink,
      const std::function<void(int64_t done, int64_t total)>& progress) const;

 private:
  absl::StatusOr<ServerChoice> choice_;
};

// The code of the error (server/api/README.md) that the daemon answered with; "": none.
std::string AnsweredCode(const absl::Status& status);

// All pages of the list at `path`, which has no query, as one answer; `rows` is the key of its
// rows. Errors of Client::Get.
absl::StatusOr<Json> GetAllPages(const Client& client, const std::string& path,
                                 const std::string& rows);

// The exit status that a final state stands for.
int ExitOfState(const std::string& state);

// The phases of all challenges in an answer of GET /v1/challenges.
Json AllPhases(const Json& answer);

// The phase called `name`; null if there is none.
Json PhaseIn(const Json& answer, const std::string& name);

// A phase as GET /v1/challenges has it. InvalidArgumentError: no phase has that name; else an
// error of Client::Get.
absl::StatusOr<Json> FindPhaseOf(const Client& client, const std::string& phase);

// Whether the evaluation or submission with this status has ended.
inline bool HasEnded(const Json& status) {
  const std::string state = status.value("state", "");
  return state != "queued" && state != "running";
}

// Asks for `path`, something that is in progress, until an answer is `final`, showing progress
// named `what`; the last answer. A daemon that does not answer for 30 s ends the wait; one that
// restarts does not.
absl::StatusOr<Json> FollowUntil(const Client& client, const std::string& path,
                                 const std::string& what,
                                 const std::function<bool(const Json&)>& final = HasEnded);

// An evaluation with its rows; `path` without a query.
absl::StatusOr<Json> EvaluationWithRows(const Client& client, const std::string& path);

// The row of one episode of such an evaluation. OutOfRangeError if it has none.
absl::StatusOr<Json> RowOf(const Json& evaluation, int64_t episode);

// The whole log of that SHA-256, or that a row names, unpacked. DataLossError, of a row with the
// episode, if it was altered; the daemon's error if it is gone; FailedPreconditionError if the row
// names none.
absl::StatusOr<std::string> FetchLogBytes(const Client& client, const std::string& sha256);
absl::StatusOr<std::string> FetchLogBytes(const Client& client, const Json& row);
absl::StatusOr<EpisodeLog> FetchEpisodeLog(const Client& client, const Json& row);

// Help of --reason.
inline constexpr char kReasonHelp[] = "Why, for the record; up to 200 bytes";

// "?key=value&key=value" of the values that are not "".
std::string BuildQuery(const std::vector<std::pair<const char*, std::string>>& values);

// Sets `key` of a request's body, unless the value is "".
void SetIfGiven(Json& body, const char* key, const std::string& value);

struct DaemonOptions : ServerOptions {
  bool json = false;

  Client client() const;

  // Ask the daemon and print what it answers. Errors of Client.
  absl::StatusOr<int> GetAndPrint(const std::string& path, const AnswerPrinter& print) const;
  absl::StatusOr<int> PostAndPrint(const std::string& path, const Json& body,
                                   const AnswerPrinter& print) const;
  // All pages of a list, as PrintList (verbs.h) prints one.
  absl::StatusOr<int> ListAndPrint(const std::string& path, const std::string& rows,
                                   const std::string& none,
                                   const std::vector<RowColumn>& columns) const;
};

void AddCaFile(CLI::App& verb, std::string& file);

// Adds --json, and with --server, --ca-file, --data and --socket where the daemon is. `schema` and
// `json_help` as for AddJson.
void AddDaemonOptions(CLI::App& verb, const std::string& schema, DaemonOptions& options,
                      const std::string& json_help = "Print JSON");

// Adds only --data, --socket, --server and --ca-file.
void AddPlaces(CLI::App& verb, DaemonOptions& options);

// Parts of a verb that speak to a daemon; `Options` are DaemonOptions.
template <typename Options>
class DaemonParts : public Parts<Options> {
 public:
  using Parts<Options>::Parts;

  // `schema` as for AddJson.
  CLI::App* Add(const std::string& name, const std::string& does, const std::string& example,
                const std::string& schema,
                std::function<absl::StatusOr<int>(const Options&)> action) {
    CLI::App* part = Parts<Options>::Add(name, does, example, std::move(action));
    AddDaemonOptions(*part, schema, this->options());
    return part;
  }
};

// Which board.
struct BoardChoice {
  std::string track;
  std::string profile;
  std::string phase;
  std::string board = "main";
  std::string config;  // its hash, or the first digits of it
  std::string at;      // as it was at that moment; "": as it is now

  bool named() const { return !track.empty() || !phase.empty() || !config.empty(); }
  std::string Query() const;  // "?board=main&phase=final"
};

// Adds --track, --phase, --profile, --board and --config.
void AddBoardChoice(CLI::App& verb, BoardChoice& choice, const std::string& track_help,
                    const std::string& phase_help);

// Of verbs about one submission.
struct SubmissionOptions : DaemonOptions {
  int64_t id = 0;

  // The submission's resource in the API, or with "/result" and the like a part of it.
  std::string Resource(const std::string& part = "") const;
};

// Adds ID, the number of a submission.
void AddSubmissionId(CLI::App& verb, SubmissionOptions& options, bool required = true,
                     const std::string& help = "The submission");

}  // namespace myograde::server
