// What server.json says of webhooks: who is told what.
#pragma once

#include <set>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

inline constexpr size_t kMostWebhooks = 16;

struct WebhookConfig {
  std::string name;         // letters, digits, ".", "_", "-"; unique
  std::string url;
  std::string secret_file;  // absolute
  std::set<std::string> events;
  std::string ca_file;      // absolute; "": the host's authorities
  absl::Duration timeout = absl::Seconds(10);        // of one attempt, as a whole
  absl::Duration give_up_after = absl::Hours(24);    // since the event
};

// The array at `webhooks`. Files and URLs are checked when the daemon starts (server/webhook).
absl::StatusOr<std::vector<WebhookConfig>> ReadWebhooks(const nlohmann::json& json,
                                                        const std::string& where);

}  // namespace myograde::server
