// One attempt to deliver an event.
#pragma once

#include <functional>
#include <string>

#include <absl/time/time.h>

#include "server/webhook/webhook.h"

namespace myograde::server {

struct PostResult {
  bool delivered = false;
  int http = 0;         // status of the answer; 0: there was none
  std::string problem;  // one sentence without the URL; "" if delivered
};

// Sends `body` (JSON, with the id `event_id`) signed as of `now`, and takes a status of 2xx for
// delivered. TLS is verified, redirects are not followed, and no proxy is used. Whatever the other
// end does, it takes no longer than the webhook's timeout and little memory, and ends within a fifth
// of a second once `stop` says so.
PostResult Post(const Webhook& webhook, const std::string& event_id, const std::string& body,
                absl::Time now, const std::function<bool()>& stop);

}  // namespace myograde::server
