// Options of verbs that speak to a daemon.
#pragma once

#include <absl/status/statusor.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/server_choice.h"
#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// What acts ask for and keep.
inline constexpr char kReasonHelp[] = "Why, for the record; up to 200 bytes";

// "?key=value&key=value" of the values that are not "".
std::string QueryOf(const std::vector<std::pair<const char*, std::string>>& values);

// Sets `key` of a request's body, unless the value is "".
void SetIfGiven(Json& body, const char* key, const std::string& value);

struct DaemonOptions : ServerOptions {
  bool json = false;

  Client client() const;

  // Ask the daemon and print what it answers (print_json.h). Errors of Client.
  absl::StatusOr<int> GetAndPrint(const std::string& path, const AnswerPrinter& print) const;
  absl::StatusOr<int> PostAndPrint(const std::string& path, const Json& body,
                                   const AnswerPrinter& print) const;
  // All pages of a list, as PrintList (report.h) prints one.
  absl::StatusOr<int> ListAndPrint(const std::string& path, const std::string& rows,
                                   const std::string& none,
                                   const std::vector<RowColumn>& columns) const;
};

// Adds --ca-file.
void AddCaFile(CLI::App& verb, std::string& file);

// Adds --json, and with --server, --ca-file, --data and --socket where the daemon is. `schema` and
// `json_help` as for AddJson.
void AddDaemonOptions(CLI::App& verb, const std::string& schema, DaemonOptions& options,
                      const std::string& json_help = "Print JSON");

// Adds --data, --socket, --server and --ca-file alone.
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
