// Where the daemon finds its configs, and what it reads there.
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/access/identity.h"
#include "server/base/paths.h"
#include "server/base/secret.h"
#include "server/config/server_config.h"
#include "server/daemon/daemon.h"
#include "server/http/tcp_listener.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMinMetricsToken = 16;
constexpr size_t kMaxMetricsToken = 256;

// The option, else the environment variable, else the default folder.
void Fill(std::string& option, const char* variable, const std::function<std::string()>& usual) {
  if (option.empty()) option = EnvironmentVariable(variable);
  if (option.empty()) option = usual();
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
                           const scoring::StatisticsConfig& usual,
                           std::vector<std::string>& mistakes) {
  for (const ChallengeConfig& challenge : challenges) {
    for (const PhaseConfig& phase : challenge.phases) {
      const absl::Status fits = PhaseStatistics(phase, usual).status();
      if (!fits.ok()) mistakes.push_back(challenge.where + ": " + std::string(fits.message()));
    }
  }
}

}  // namespace

DaemonOptions WithDefaults(DaemonOptions options) {
  Fill(options.data_dir, "MYOGRADE_DATA", UsualDataDir);
  Fill(options.cache_dir, "MYOGRADE_CACHE", UsualCacheDir);
  Fill(options.configs_dir, "MYOGRADE_CONFIG_DIR", ConfigDir);
  if (options.socket.empty()) options.socket = options.data_dir + "/myograde.sock";
  options.socket = fs::absolute(options.socket).lexically_normal();
  // The runners that this process starts read their sandbox configs there too.
  setenv("MYOGRADE_CONFIG_DIR", options.configs_dir.c_str(), /*overwrite=*/1);
  return options;
}

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

}  // namespace myograde::server
