// The daemon's settings: configs/server.json. None of them changes a result.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/lease/track_config.h"
#include "server/scheduler/host_health.h"
#include "server/scheduler/scheduler.h"
#include "server/store/store.h"

namespace myograde::server {

struct HttpLimits {
  int workers = 0;
  int clients = 0;
  absl::Duration request;
  absl::Duration upload;
  absl::Duration idle;
  int64_t body_bytes = 0;
  unsigned socket_mode = 0600;
  // Organisers are root and the user that runs the daemon.
  int organiser_workers = 4;       // of `workers`; at most half of them
  int organiser_clients = 16;      // of `clients`
  int peer_clients = 128;          // connections of one user who is no organiser
  int64_t min_bytes_per_s = 1024;  // of a request that arrives, and of an answer that is read
  absl::Duration speed_window = absl::Seconds(30);
  int64_t spool_bytes = int64_t{32} << 30;  // bodies on the disk, of all and of one user
  int64_t peer_spool_bytes = int64_t{16} << 30;
  int64_t disk_reserve = 0;        // UploadLimits::disk_reserve
  int large_uploads = 1;           // UploadLimits::uploads

  // Newcomers who wait while all connections that they may have are busy: of all and of one user.
  int waiting() const { return clients; }
  int peer_waiting() const { return clients * 3 / 4; }
};

struct UploadLimits {
  int64_t archive_bytes = 0;
  int64_t bytes = 0;
  int64_t files = 0;
  int64_t unpack_memory_bytes = 0;
  int uploads = 0;            // of more than 1 MiB that are unpacked at once
  absl::Duration unpack_cpu = absl::Seconds(300);
  int64_t disk_reserve = int64_t{512} << 20;  // bytes of the disk that uploads leave free
  UnsubmittedLimits unsubmitted;
};

// What teams may hand in. Settings of a host and a challenge, not of a track's
// config: they change no result, and a change of them makes no new board.
struct QuotaConfig {
  AdmissionRules usual;
  std::map<std::string, AdmissionRules> tracks;  // those that have their own

  const AdmissionRules& of(const std::string& track) const {
    const auto it = tracks.find(track);
    return it == tracks.end() ? usual : it->second;
  }
};

// What is removed of the data folder, and when (retention.h).
struct RetentionLimits {
  absl::Duration artefact_age;   // since an artefact was last of use
  int64_t artefact_bytes = 0;    // of all artefacts together
  absl::Duration log_age;        // since an episode's log was written
  int64_t log_bytes = 0;         // of all logs together
  absl::Duration every;          // between two looks
  absl::Duration upload_age;     // UnsubmittedLimits::age
};

struct ServerConfig {
  SchedulerLimits scheduler;
  HostLimits host;
  absl::Duration self_test_deadline;
  absl::Duration lease_grace;
  int64_t uid_base = 0;
  bool pin_slots = false;
  std::map<std::string, std::string> runtimes;  // name to host folder
  UploadLimits artefacts;
  HttpLimits http;
  QuotaConfig quota;
  RerunLimits reruns;
  RetentionLimits retention;
  std::string log_level;
};

// Whether slots of a track keep to one processor each: all processors have a slot, and the track's
// policies have one processor.
bool PinsSlots(const ServerConfig& config, int slots, const TrackConfig& track);

// File descriptors that a daemon of these limits may have open at once.
int64_t DescriptorsNeeded(const ServerConfig& config);

// Reads `path`; `cache_dir` stands for ${cache} in it. Every key must be there but
// those that an earlier version did not have, which have defaults; the error names
// the file and the key. A runtime's folder is not looked for
// here: a missing one matters only to the submissions that ask for it.
absl::StatusOr<ServerConfig> LoadServerConfig(const std::string& path,
                                              const std::string& cache_dir);

}  // namespace myograde::server
