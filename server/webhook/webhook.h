// A webhook that can be used: its settings with the secret, checked.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/config/webhook_config.h"
#include "server/store/deliveries.h"

namespace myograde::server {

struct Webhook {
  WebhookConfig config;
  std::string secret;
};

// Reads the secrets and checks URLs and files. InvalidArgumentError, in one sentence that names the
// webhook, for a URL that is not https, or http to this host; that has a user, a password or a
// fragment; for a secret as of ReadSecretFile; for a ca_file that can't be read.
absl::StatusOr<std::vector<Webhook>> LoadWebhooks(const std::vector<WebhookConfig>& configs);

Subscriptions SubscriptionsOf(const std::vector<Webhook>& webhooks);

}  // namespace myograde::server
