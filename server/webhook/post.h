// One attempt to deliver an event.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include <absl/time/time.h>

#include "server/webhook/webhook.h"

namespace myograde::server {

inline constexpr char kSignatureHeader[] = "X-MyoGrade-Signature";
inline constexpr char kEventIdHeader[] = "Idempotency-Key";

// How a receiver knows that an event came from this daemon, and when: "t=1764590400,v1=DIGITS", the
// time of the attempt in seconds since 1970, and the HMAC-SHA256 of "1764590400.BODY" keyed with
// the secret's bytes, in lower-case hexadecimal.
std::string SignatureOf(std::string_view secret, int64_t seconds, std::string_view body);

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
