// Connections to a daemon, and in words why there is none.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <httplib.h>

#include <ctime>
#include <memory>

#include "server/cli/client/server_choice.h"

namespace myograde::server {

// A client for requests to `choice`, each of which is answered within `answer_seconds` or fails. It
// shows the token there, follows no redirection, and over TLS speaks only to a server whose
// certificate is trusted and is for the host of the address. Nothing is connected yet.
absl::StatusOr<std::unique_ptr<httplib::ClientImpl>> Connect(const ServerChoice& choice,
                                                             std::time_t answer_seconds);

// Why a request of `http` to `choice` had no answer: UnavailableError with a sentence that says
// what to do.
absl::Status NoAnswer(const ServerChoice& choice, const httplib::ClientImpl& http,
                      httplib::Error error);

}  // namespace myograde::server
