// What the API's resources share.
#pragma once

#include <string>

#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "server/admission/admission.h"
#include "server/api/access_log.h"
#include "server/api/documents.h"
#include "server/api/record_log.h"
#include "server/challenge/offered_tracks.h"
#include "server/challenge/phases.h"
#include "server/config/server_config.h"
#include "server/engine/engine.h"
#include "server/metrics/metrics.h"
#include "server/pictures/pictures.h"
#include "server/proof/signing_key.h"
#include "server/store/store.h"
#include "server/webhook/sender.h"

namespace myograde::server {

// The references are to objects of the daemon, which outlive the HTTP server.
struct ApiContext {
  const ServerConfig& config;
  std::string data_dir;
  std::string cache_dir;
  std::string tracks_dir;  // where "extends" of a config that a client sends is looked up
  Tracks& tracks;  // rejudges give boards other configs (server/challenge/phases.h)
  Phases& phases;
  Admission& admission;
  Engine& engine;
  ReaderPool& readers;
  KeyFile& receipts_key;
  AccessLog& access_log;
  RecordLog& record;
  Pictures& pictures;
  Metrics& metrics;
  WebhookSender& webhooks;
  const Documents& documents;
  // SHA-256 of the token with which a scraper reads the metrics; "": there is none.
  std::string metrics_token;
  // Whether there is a challenge (server/challenge): then a user of this host is nobody until an
  // organiser says who, and organisers create the teams.
  bool challenge = false;
  const Clock& clock;
  absl::Time started_at;   // by the calendar
  absl::Duration began;    // the same on the monotonic clock
};

}  // namespace myograde::server
