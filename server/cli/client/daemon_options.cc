#include "server/cli/client/daemon_options.h"

#include <absl/strings/str_cat.h>

#include "server/cli/base/options.h"
#include "server/cli/base/places.h"

namespace myograde::server {

Client DaemonOptions::client() const { return Client(SocketPath(socket, data)); }

void AddDaemonOptions(CLI::App& verb, const std::string& schema, DaemonOptions& options,
                      const std::string& json_help) {
  AddJson(verb, schema, options.json, json_help);
  AddPlaces(verb, options);
}

void AddPlaces(CLI::App& verb, DaemonOptions& options) {
  verb.add_option("--data", options.data,
                  "Data folder of the daemon (default: MYOGRADE_DATA, else /var/lib/myograde for "
                  "root and ~/.local/share/myograde for others)");
  verb.add_option("--socket", options.socket, "The daemon's socket (default: DATA/myograde.sock)");
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
