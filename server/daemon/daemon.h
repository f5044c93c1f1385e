// The program myograded, from options to exit: what it is started with, and the steps of its start
// (start.cc), which say what it takes from its folder, host and store and tells them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/api/record_log.h"
#include "server/base/data_folder.h"
#include "server/challenge/offered_tracks.h"
#include "server/challenge/phases.h"
#include "server/config/server_config.h"
#include "server/executor/executor.h"
#include "server/proof/signing_key.h"
#include "server/store/store.h"
#include "server/webhook/webhook.h"

namespace myograde::server {

struct DaemonOptions {
  std::string data_dir;
  std::string socket;       // "" is DATA/myograde.sock
  std::string configs_dir;
  std::string cache_dir;
};

struct DaemonConfigs {
  ServerConfig server;
  Tracks tracks;
  std::vector<ChallengeConfig> challenges;  // without a mistake
  std::vector<Webhook> webhooks;
  std::string metrics_token;  // its SHA-256; "": there is none
};

// Makes a copy of another daemon's data folder, which must have a store and no running daemon, one of
// its own, and returns a sentence that says so.
absl::StatusOr<std::string> AdoptData(const std::string& data_dir);

// Serves until SIGTERM or SIGINT. OkStatus() after an orderly stop; an error says why it could not
// start or continue.
absl::Status RunDaemon(const DaemonOptions& options, DaemonConfigs configs);

// Raises the limit to the number of descriptors that the config may use.
absl::Status RaiseDescriptorLimit(const ServerConfig& config);
// Makes the folders below `data`, which are private to the daemon, starts the log, and removes what
// an earlier daemon that died was working on.
absl::Status PrepareFolder(const std::string& data, const ServerConfig& config);
// Whoever lost the store should hear of it before the next submission gets number 1.
void WarnOfLostStore(const std::string& data_dir, const std::string& path);

// Finds out whether the data folder `data` is a copy of the one that its `store` was last used in. Where
// leases run only on this host, or with `adopt`, it is then a store of its own; elsewhere `held_back`
// says why this daemon must not touch the cluster.
struct HomeFound {
  DataHome home;
  std::string held_back;  // "": nothing is
};
absl::StatusOr<HomeFound> FindHome(const std::string& data, Store& store, bool on_cluster,
                                   bool adopt);

// The phases of the configs; a phase's secret is drawn when a daemon first loads it. Phases and
// tracks get the configs that boards have by the store, where that is not what the files say. Logs
// what an organiser may have changed without meaning to.
absl::StatusOr<Phases> TakePhases(DaemonConfigs& configs, Store& store, ReaderPool& readers,
                                  absl::Time now);

// What waits for webhooks that are no more is given up.
absl::Status SetWebhooks(const std::vector<Webhook>& webhooks, Store& store);

// Adds the key that signs to the public record, and logs where the record was changed. A record
// without entries stays so, as an import needs an empty store.
absl::Status StartRecord(Store& store, ReaderPool& readers, KeyFile& receipts_key,
                         RecordLog& record);

// Logs a warning if the configs want the network, but the service manager filters what this process
// sends to other hosts (systemd's IPAddressDeny=). `handed`: the TCP port is the service manager's,
// whose own filter counts.
void WarnOfFilteredPackets(const DaemonConfigs& configs, bool handed);

// Where leases run, by the config. The store's home tells its jobs from another's, copies of the same
// store included.
absl::StatusOr<std::unique_ptr<Executor>> MakeExecutor(const DaemonOptions& options,
                                                       const ServerConfig& config,
                                                       const HomeFound& home);

}  // namespace myograde::server
