// The daemon's settings, configs/server.json. None of them affects a result.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/track_config.h"
#include "scoring/statistics_config.h"
#include "server/access/access.h"
#include "server/base/log_line.h"
#include "server/config/limits.h"
#include "server/config/slurm_config.h"
#include "server/config/webhook_config.h"
#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"

namespace myograde::server {

struct HttpLimits {
  int workers = 0;
  int clients = 0;
  absl::Duration request;
  absl::Duration upload;
  absl::Duration idle;
  int64_t body_bytes = 0;
  unsigned socket_mode = 0600;
  // Organisers are root, the user that runs the daemon, and those that `access` names.
  int organiser_workers = 4;       // of `workers`; at most half of them
  int organiser_clients = 16;      // of `clients`
  int peer_clients = 128;          // connections per user who is not an organiser
  int address_clients = 32;        // connections per address of the network; as many may begin each
                                   // second
  int64_t min_bytes_per_s = 1024;  // slowest accepted rate of an arriving request and of an answer
                                   // being read
  absl::Duration speed_window = absl::Seconds(30);
  int64_t spool_bytes = int64_t{32} << 30;  // request bodies on disk: total, and per user
  int64_t peer_spool_bytes = int64_t{16} << 30;
  double requests_per_s = 100;     // per caller who is not an organiser: on average, and at once
  double burst = 1000;
  int64_t disk_reserve = 0;        // UploadLimits::disk_reserve
  int large_uploads = 1;           // UploadLimits::uploads

  // Connections kept waiting while all permitted ones are busy: total, and per user.
  int waiting() const { return clients; }
  int peer_waiting() const { return clients * 3 / 4; }
  // For a TLS handshake.
  absl::Duration handshake() const { return std::min(request, absl::Seconds(10)); }
};

// The daemon's door to the network, beside its Unix socket.
struct ListenConfig {
  std::string address;       // numeric; one of this host, or 0.0.0.0 or :: for all
  int port = 0;              // 0: the kernel chooses one
  std::string certificate;   // files in PEM; both "" for plain HTTP, on a loopback address only
  std::string key;
  bool behind_proxy = false; // X-Forwarded-For tells the caller's address; on loopback only
};

struct UploadLimits {
  int64_t archive_bytes = 0;
  int64_t bytes = 0;
  int64_t files = 0;
  int64_t unpack_memory_bytes = 0;
  int uploads = 0;            // archives above 1 MiB unpacked concurrently
  absl::Duration unpack_cpu = absl::Seconds(300);
  int64_t disk_reserve = int64_t{512} << 20;  // bytes of disk that uploads must leave free
  UnsubmittedLimits unsubmitted;
};

// How much teams may submit. Settings of a host and a challenge rather than of a track's config:
// they affect no result, and changing them makes no new board.
struct QuotaConfig {
  AdmissionRules defaults;
  std::map<std::string, AdmissionRules> tracks;  // tracks with their own rules

  const AdmissionRules& of(const std::string& track) const {
    const auto it = tracks.find(track);
    return it == tracks.end() ? defaults : it->second;
  }
};

// What is removed from the data folder, and when (retention.h).
struct RetentionLimits {
  absl::Duration artefact_age;   // since an artefact's last use
  int64_t artefact_bytes = 0;    // total of all artefacts
  absl::Duration log_age;        // since an episode's log was written
  int64_t log_bytes = 0;         // total of all logs
  int64_t picture_bytes = int64_t{1} << 30;  // total of all trajectories and pictures
  absl::Duration every;          // between sweeps
  absl::Duration upload_age;     // UnsubmittedLimits::age
};

struct ServerConfig {
  // Of leases that run on a cluster the slots are its jobs: SlurmConfig::most_jobs.
  SchedulerLimits scheduler;
  bool on_cluster = false;  // "executor": "slurm"
  SlurmConfig slurm;
  HostLimits host;
  absl::Duration self_test_deadline;
  absl::Duration lease_grace;
  int64_t uid_base = 0;
  bool pin_slots = false;
  std::map<std::string, std::string> runtimes;  // name to host folder
  std::string runtimes_dir;                     // of `myograde runtime add` (server/runtime)
  UploadLimits artefacts;
  HttpLimits http;
  AccessConfig access;                 // names not resolved yet (ResolveNames)
  std::optional<ListenConfig> listen;  // nullopt: no door to the network
  QuotaConfig quota;
  RerunLimits reruns;
  RetentionLimits retention;
  // How long no lease has run or waited when pictures are made that nobody asked for yet; infinite:
  // they never are (server/pictures).
  absl::Duration pictures_ahead = absl::Seconds(30);
  bool public_replay = false;  // IsReplayPublic: allowed for boards that are of no phase
  scoring::StatisticsConfig statistics;
  std::string log_level;
  LogFormat log_format = LogFormat::kText;
  std::string metrics_token_file;  // absolute; "": only organisers read /metrics
  std::vector<WebhookConfig> webhooks;
};

// Whether a track's slots are pinned to one processor each: every processor has a slot, and the
// track's policies get one processor.
bool PinsSlots(const ServerConfig& config, int slots, const TrackConfig& track);

// File descriptors that a daemon with these limits may have open at once.
int64_t DescriptorsNeeded(const ServerConfig& config);

// Reads `path`, replacing ${cache} by `cache_dir`. Every key is required except those with defaults
// above; the error names the file and the key. Runtime folders are not checked here: a missing one
// matters only to the submissions that ask for it.
absl::StatusOr<ServerConfig> LoadServerConfig(const std::string& path,
                                              const std::string& cache_dir);

// Turns the names in `access` into ids, as the host's user database has them now.
// InvalidArgumentError that names the entry, with `where` in front: this host has no such user or
// group.
absl::Status ResolveNames(const std::string& where, AccessConfig& access);

}  // namespace myograde::server
