// The program's words and exit statuses, where it finds its configs, and what it reads there.
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/status_macros.h"
#include "server/access/identity.h"
#include "server/base/log_line.h"
#include "server/base/paths.h"
#include "server/base/plain_text.h"
#include "server/base/secret.h"
#include "server/daemon/daemon.h"
#include "server/http/tcp_listener.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// The project's exit statuses: 2 wrong use, 4 trouble with the grader or its host.
constexpr int kWrongUse = 2;
constexpr int kTrouble = 4;
constexpr size_t kMinMetricsToken = 16;
constexpr size_t kMaxMetricsToken = 256;

// The option, else the environment variable, else the default folder.
void Fill(std::string& option, const char* variable, const std::function<std::string()>& fallback) {
  if (option.empty()) option = EnvironmentVariable(variable);
  if (option.empty()) option = fallback();
  option = fs::absolute(option).lexically_normal();
  if (option.size() > 1 && option.ends_with('/')) option.pop_back();
}

// The SHA-256 of the token in a file; "" without a file.
absl::StatusOr<std::string> LoadMetricsToken(const std::string& path) {
  if (path.empty()) return std::string();
  const absl::StatusOr<std::string> token = ReadSecretFile(path, kMinMetricsToken, kMaxMetricsToken);
  if (!token.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "server.json: metrics: token_file: ", std::string(token.status().message())));
  }
  return TokenHash(*token);
}

// A phase's statistics must also fit those that the server has for the keys that it leaves out.
void AddStatisticsMistakes(const std::vector<ChallengeConfig>& challenges,
                           const scoring::StatisticsConfig& fallback,
                           std::vector<std::string>& mistakes) {
  for (const ChallengeConfig& challenge : challenges) {
    for (const PhaseConfig& phase : challenge.phases) {
      const absl::Status fits = PhaseStatistics(phase, fallback).status();
      if (!fits.ok()) mistakes.push_back(challenge.where + ": " + std::string(fits.message()));
    }
  }
}

// Fills in empty options: --data from MYOGRADE_DATA, else /var/lib/myograde for root and the XDG
// data folder for others; --configs from MYOGRADE_CONFIG_DIR, else the folder that the program was
// built with; --cache from MYOGRADE_CACHE, else DefaultCacheDir() (server/base/paths.h): the XDG cache
// folder for others. Paths become absolute.
DaemonOptions WithDefaults(DaemonOptions options) {
  Fill(options.data_dir, "MYOGRADE_DATA", DefaultDataDir);
  Fill(options.cache_dir, "MYOGRADE_CACHE", DefaultCacheDir);
  Fill(options.configs_dir, "MYOGRADE_CONFIG_DIR", ConfigDir);
  if (options.socket.empty()) options.socket = options.data_dir + "/myograde.sock";
  options.socket = fs::absolute(options.socket).lexically_normal();
  // The runners that this process starts read their sandbox configs there too.
  setenv("MYOGRADE_CONFIG_DIR", options.configs_dir.c_str(), /*overwrite=*/1);
  return options;
}

// Reads everything in options.configs_dir. An error names the file and the key.
absl::StatusOr<DaemonConfigs> LoadConfigs(const DaemonOptions& options) {
  ASSIGN_OR_RETURN(ServerConfig server,
                   LoadServerConfig(options.configs_dir + "/server.json", options.cache_dir));
  RETURN_IF_ERROR(ResolveNames(options.configs_dir + "/server.json", server.access));
  if (server.listen.has_value()) {
    RETURN_IF_ERROR(CheckCertificate(*server.listen));
  }
  ASSIGN_OR_RETURN(std::vector<Webhook> webhooks, LoadWebhooks(server.webhooks));
  ASSIGN_OR_RETURN(std::string metrics_token, LoadMetricsToken(server.metrics_token_file));
  ASSIGN_OR_RETURN(Tracks tracks, Tracks::Load(options.configs_dir + "/tracks"));
  // The runners read it; better to report a mistake once now than in every lease.
  RETURN_IF_ERROR(LoadSandboxConfig(options.configs_dir).status());
  std::vector<std::string> mistakes;
  std::vector<ChallengeConfig> challenges =
      ReadChallenges(options.configs_dir + "/challenges", mistakes);
  if (mistakes.empty()) {
    mistakes = CheckChallenges(challenges, tracks, absl::InfinitePast()).mistakes;
  }
  AddStatisticsMistakes(challenges, server.statistics, mistakes);
  if (!mistakes.empty()) return MistakesToStatus(mistakes);
  return DaemonConfigs{std::move(server), std::move(tracks), std::move(challenges),
                       std::move(webhooks), std::move(metrics_token)};
}

int Fail(int exit_status, const std::string& error) {
  std::cerr << "myograded: error: " << Sanitized(error) << "\n";
  return exit_status;
}

int Main(int argc, char** argv) {
  DaemonOptions options;
  CLI::App app{"The MyoGrade daemon: accepts, evaluates and ranks submissions.\n"
               "Example: myograded --data ~/myograde-data"};
  app.add_option("--data", options.data_dir,
                 "Folder of the store and the submissions (default: MYOGRADE_DATA, else "
                 "/var/lib/myograde for root, the XDG data folder for others)");
  app.add_option("--socket", options.socket, "Socket to listen on (default: DATA/myograde.sock)");
  app.add_option(
      "--configs", options.configs_dir,
      "Folder with server.json and tracks/ (default: MYOGRADE_CONFIG_DIR, else the built-in path)");
  app.add_option("--cache", options.cache_dir,
                 "Folder with MuJoCo and the models (default: MYOGRADE_CACHE, else "
                 "the XDG cache folder if it has models, else /var/cache/myograde)");
  bool adopt = false;
  app.add_flag("--adopt", adopt,
               "Only take over a copy of another daemon's data folder, where leases run on a "
               "cluster (OPERATIONS.md, 'Copies of a data folder'); stop the daemon first");
  app.set_version_flag("--version", MYOGRADE_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    return app.exit(asked);
  } catch (const CLI::ParseError& mistake) {
    return Fail(kWrongUse, std::string(mistake.what()) + "; see \"myograded --help\"");
  }
  options = WithDefaults(options);
  if (adopt) {
    const absl::StatusOr<std::string> done = AdoptData(options.data_dir);
    if (!done.ok()) return Fail(kTrouble, std::string(done.status().message()));
    std::cout << Sanitized(*done) << "\n";
    return 0;
  }
  absl::StatusOr<DaemonConfigs> configs = LoadConfigs(options);
  if (!configs.ok()) return Fail(kWrongUse, std::string(configs.status().message()));
  const LogFormat format = configs->server.log_format;
  const absl::Status status = RunDaemon(options, *std::move(configs));
  if (status.ok()) return 0;
  if (format == LogFormat::kText) return Fail(kTrouble, std::string(status.message()));
  std::cerr << LogLine(format, absl::Now(), "critical", std::string(status.message()));
  return kTrouble;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
