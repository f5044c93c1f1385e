// The guard before the handlers: finds out who makes a request, holds it against their limits, and
// decides by their role whether they may take the action of the address. Each denial is recorded.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "server/access/identity.h"
#include "server/access/rate_limit.h"
#include "server/api/context.h"
#include "server/http/connection.h"
#include "server/http/router.h"

namespace myograde::server {

// Safe from any thread.
class Guard {
 public:
  // `context` must outlive it.
  explicit Guard(const ApiContext& context);

  // Each function returns why the request is refused; nullopt: it is not.

  // Finds out who makes the connection's request, and whether they may take `action` at all;
  // whether they may do so for a team is the handler's to ask (Require of caller.h). Counts the
  // request once, however often it is asked about.
  std::optional<ApiError> Admit(Connection& connection, Action action, Identity& who);
  // The same by the address in the request's head, before its body is received. One that is unknown
  // is answered later. Of a team's uploads over the network, however many tokens and addresses it has,
  // half of `address_clients` are received at a time; connection.upload is such a place.
  std::optional<ApiError> AdmitBody(Connection& connection, const Router& router);
  // Counts a request to an address that there is none of.
  std::optional<ApiError> AdmitUnknown(Connection& connection);

 private:
  // nullopt in place of an action: the address is unknown.
  std::optional<ApiError> Identify(const Peer& peer, const Request& head,
                                   std::optional<Action> action, Identity& who);
  std::optional<ApiError> IdentifyUser(const Peer& peer, std::optional<Action> action,
                                       Identity& who);
  std::optional<ApiError> IdentifyToken(const Peer& peer, std::string_view authorization,
                                        Action action, Identity& who);
  std::optional<ApiError> CheckTries(const Peer& peer, const std::string& hash);
  ApiError RefuseToken(const Peer& peer, const std::string& hash, TokenProblem problem,
                       const std::optional<TokenRow>& row, Action action);
  void Accept(const std::string& hash, int64_t token);
  std::optional<ApiError> Count(const Identity& identity);
  std::optional<ApiError> TakeUpload(Connection& connection, const Identity& identity);

  // Being received, by team or token. Connections may outlive the guard.
  struct Uploads {
    Mutex mutex;
    std::map<std::string, int> of ABSL_GUARDED_BY(mutex);
  };

  const ApiContext& context_;
  const std::shared_ptr<Uploads> uploads_ = std::make_shared<Uploads>();
  Mutex mutex_;
  RateLimit requests_ ABSL_GUARDED_BY(mutex_);
  BackOff wrong_tokens_ ABSL_GUARDED_BY(mutex_);
  // Hashes of tokens that were accepted, and when that was last noted: their holders do not wait
  // for those at the same address who guess.
  RecentKeys<absl::Duration> good_tokens_ ABSL_GUARDED_BY(mutex_);
};

// Whether a user of this host is an organiser by the settings, for the places that are kept free.
bool IsOrganiser(const Peer& peer, const AccessConfig& access);

// The path of an address for people: ID, HASH and NAME in place of groups.
std::string PathOf(const std::string& address);

}  // namespace myograde::server
