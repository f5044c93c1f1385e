// myograde serve: becomes the daemon.
#include <absl/strings/str_cat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/paths.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/offline/verbs.h"

namespace myograde::server {
namespace {

struct ServeOptions {
  std::string data;
  std::string socket;
  HostOptions host;
  bool adopt = false;
};

absl::StatusOr<int> Serve(const ServeOptions& options) {
  ASSIGN_OR_RETURN(const std::string bin, HostStatus("", BinDir()));
  std::vector<std::string> words = {bin + "/myograded"};
  const auto pass = [&](const char* name, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {name, value});
  };
  pass("--data", options.data);
  pass("--socket", options.socket);
  pass("--configs", options.host.configs);
  pass("--cache", options.host.cache);
  if (options.adopt) words.emplace_back("--adopt");
  ::execv(words[0].c_str(), ExecVector(words).data());
  return absl::InternalError(
      absl::StrCat("the daemon's program ", words[0], " can't be started: ", std::strerror(errno)));
}

}  // namespace

Action AddServe(CLI::App& verb) {
  auto options = std::make_shared<ServeOptions>();
  verb.add_option("--data", options->data,
                  "Folder for everything that is kept; made if missing (default: MYOGRADE_DATA, "
                  "else /var/lib/myograde for root and ~/.local/share/myograde for others)");
  verb.add_option("--socket", options->socket, "Where to listen (default: DATA/myograde.sock)");
  verb.add_flag("--adopt", options->adopt,
                "Only make a copy of another daemon's data folder this one's own, where leases run on a "
                "cluster (OPERATIONS.md, 'Copies of a data folder'); with the daemon stopped");
  AddHostOptions(verb, options->host);
  return [options] { return Serve(*options); };
}

}  // namespace myograde::server
