#include <iostream>
#include <string>
#include <utility>

#include <CLI/CLI.hpp>
#include <absl/time/clock.h>

#include "server/base/log_line.h"
#include "server/base/plain_text.h"
#include "server/daemon/daemon.h"

namespace myograde::server {
namespace {

void TellError(const std::string& error) {
  std::cerr << "myograded: error: " << Harmless(error) << "\n";
}

int Main(int argc, char** argv) {
  // The project's exit statuses: 2 wrong use, 4 trouble with the grader or its host.
  constexpr int kWrongUse = 2;
  constexpr int kTrouble = 4;
  DaemonOptions options;
  CLI::App app{"The MyoGrade daemon: takes submissions, plays and ranks them.\n"
               "Example: myograded --data ~/myograde-data"};
  app.add_option("--data", options.data_dir,
                 "Folder of the store and the submissions (default: MYOGRADE_DATA, else "
                 "/var/lib/myograde for root, the XDG data folder for others)");
  app.add_option("--socket", options.socket, "Socket to listen on (default: DATA/myograde.sock)");
  app.add_option(
      "--configs", options.configs_dir,
      "Folder with server.json and tracks/ (default: MYOGRADE_CONFIG_DIR, else as built)");
  app.add_option("--cache", options.cache_dir,
                 "Folder of the models and the physics library (default: MYOGRADE_CACHE, else "
                 "the XDG cache folder if it has models, else /var/cache/myograde)");
  bool adopt = false;
  app.add_flag("--adopt", adopt,
               "Only make a copy of another daemon's data folder this one's own, where leases run on a "
               "cluster (OPERATIONS.md, 'Copies of a data folder'); with the daemon stopped");
  app.set_version_flag("--version", MYOGRADE_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    return app.exit(asked);
  } catch (const CLI::ParseError& mistake) {
    TellError(std::string(mistake.what()) + "; see \"myograded --help\"");
    return kWrongUse;
  }
  options = WithDefaults(options);
  if (adopt) {
    const absl::StatusOr<std::string> done = AdoptData(options.data_dir);
    if (done.ok()) {
      std::cout << Harmless(*done) << "\n";
      return 0;
    }
    TellError(std::string(done.status().message()));
    return kTrouble;
  }
  absl::StatusOr<DaemonConfigs> configs = LoadConfigs(options);
  if (!configs.ok()) {
    TellError(std::string(configs.status().message()));
    return kWrongUse;
  }
  const LogFormat format = configs->server.log_format;
  const absl::Status status = RunDaemon(options, *std::move(configs));
  if (status.ok()) return 0;
  if (format == LogFormat::kJson) {
    std::cerr << LogLine(format, absl::Now(), "critical", std::string(status.message()));
  } else {
    TellError(std::string(status.message()));
  }
  return kTrouble;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
