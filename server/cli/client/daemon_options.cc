#include "server/cli/client/client.h"

#include <absl/strings/str_cat.h>

#include "server/base/http_client.h"
#include "server/cli/base/report.h"

namespace myograde::server {

std::string QueryOf(const std::vector<std::pair<const char*, std::string>>& values) {
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
                  "Certificates in PEM of the authorities that may have signed the server's "
                  "(default: MYOGRADE_CA_FILE, else the login's, else those this host trusts)");
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
                  "The daemon's address, https://HOST:PORT (default: MYOGRADE_SERVER, else what "
                  "--data says, or \"myograde login\" did)")
      ->excludes(data)
      ->excludes(socket);
  AddCaFile(verb, options.ca_file);
}

std::string BoardChoice::Query() const {
  return QueryOf({{"track", track},
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
  verb.add_option("--board", choice.board, "Name of the board (default: main, which all have)");
  verb.add_option("--config", choice.config,
                  "The board under a config that it has or had: its hash, or the first 8 digits or "
                  "more");
}

std::string SubmissionOptions::Resource(const std::string& part) const {
  return absl::StrCat("/v1/submissions/", id, part);
}

void AddSubmissionId(CLI::App& verb, SubmissionOptions& options, bool required,
                     const std::string& help) {
  verb.add_option("ID", options.id, help)
      ->required(required)
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "no submission's number, as \"myograde status\" lists them"));
}

}  // namespace myograde::server
