// The program myograded, from options to exit.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/challenge/challenge.h"
#include "server/config/server_config.h"
#include "server/grading/tracks.h"
#include "server/webhook/webhook.h"

namespace myograde::server {

struct DaemonOptions {
  std::string data_dir;
  std::string socket;       // "" is DATA/myograde.sock
  std::string configs_dir;
  std::string cache_dir;
};

// Fills in empty options: --data from MYOGRADE_DATA, else /var/lib/myograde for root and the XDG
// data folder for others; --configs from MYOGRADE_CONFIG_DIR, else the folder that the program was
// built with; --cache from MYOGRADE_CACHE, else UsualCacheDir() (server/base/paths.h): the XDG cache
// folder for others. Paths become absolute.
DaemonOptions WithDefaults(DaemonOptions options);

struct DaemonConfigs {
  ServerConfig server;
  Tracks tracks;
  std::vector<ChallengeConfig> challenges;  // without a mistake
  std::vector<Webhook> webhooks;
  std::string metrics_token;  // its SHA-256; "": there is none
};

// Reads everything in options.configs_dir. An error names the file and the key.
absl::StatusOr<DaemonConfigs> LoadConfigs(const DaemonOptions& options);

// Makes a copy of another daemon's data folder, which must have a store and no running daemon, one of
// its own, and returns a sentence that says so.
absl::StatusOr<std::string> AdoptData(const std::string& data_dir);

// Serves until SIGTERM or SIGINT. OkStatus() after an orderly stop; an error says why it could not
// start or continue.
absl::Status RunDaemon(const DaemonOptions& options, DaemonConfigs configs);

}  // namespace myograde::server
