// Requests to a daemon, and in words why there is no answer.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include <string>

#include "server/base/http_client.h"
#include "server/cli/client/server_choice.h"

namespace myograde::server {

// A request for `path` of `choice`, which ends when nothing moves for `silence`. It shows the token
// there. UnavailableError or InvalidArgumentError: the socket or the file of authorities can't be used.
absl::StatusOr<HttpRequest> RequestTo(const ServerChoice& choice, const std::string& path,
                                      absl::Duration silence);

// Why a request to `choice` failed: UnavailableError with a sentence that says what to do.
absl::Status NoAnswer(const ServerChoice& choice, const HttpAnswer& answer);

}  // namespace myograde::server
