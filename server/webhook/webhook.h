// A webhook that can be used (its settings with the secret, checked), and one attempt to deliver an
// event to it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "server/config/webhook_config.h"

namespace myograde::server {

struct Webhook {
  WebhookConfig config;
  std::string secret;
};

// Reads the secrets and checks URLs and files. InvalidArgumentError, in one sentence that names the
// webhook, for a URL that is not https, or http to this host; that has a user, a password or a
// fragment; for a secret as of ReadSecretFile; for a ca_file that can't be read.
absl::StatusOr<std::vector<Webhook>> LoadWebhooks(const std::vector<WebhookConfig>& configs);

// How a receiver knows that an event came from this daemon, and when: "t=1764590400,v1=DIGITS", the
// time of the attempt in seconds since 1970, and the HMAC-SHA256 of "1764590400.BODY" keyed with
// the secret's bytes, in lower-case hexadecimal.
std::string ComputeSignature(std::string_view secret, int64_t seconds, std::string_view body);

struct PostResult {
  bool delivered = false;
  int http = 0;         // status of the answer; 0: there was none
  std::string problem;  // one sentence without the URL; "" if delivered
};

// Sends `body` (JSON, with the id `event_id`) signed as of `now`, and takes a status of 2xx for
// delivered. TLS is verified, redirects are not followed, and no proxy is used. Whatever the other
// end does, it takes no longer than the webhook's timeout and little memory, and ends within a
// fifth of a second once `stop` says so.
PostResult Post(const Webhook& webhook, const std::string& event_id, const std::string& body,
                absl::Time now, const std::function<bool()>& stop);

}  // namespace myograde::server
