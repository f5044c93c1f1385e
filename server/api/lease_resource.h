// /v1/leases/NAME: what the nodes of a cluster need that share no folder with the daemon
// (server/executor/lease_door.h). Each lease has a token of its own, which the guard checks.
#pragma once

#include <optional>
#include <string>

#include "server/api/context.h"
#include "server/api/routes.h"
#include "server/executor/lease_door.h"

namespace myograde::server {

// Safe from any thread.
class LeaseResource {
 public:
  // `door`: nullptr where nodes don't come this way; then no lease is there. Must outlive it.
  explicit LeaseResource(LeaseDoor* door) : door_(door) {}

  void Install(Routes& routes);

 private:
  ApiResult GetOrder(const Request& request) const;
  absl::Status GetArtefact(const Request& request, Response& response) const;
  ApiResult TakeClaim(const Request& request) const;
  ApiResult TakeProof(const Request& request) const;
  ApiResult TakeRecords(const Request& request) const;
  ApiResult TakeLog(const Request& request) const;
  ApiResult TakeEnd(const Request& request) const;
  // Whether the caller is the node that plays it.
  absl::Status CheckCaller(const Request& request) const;

  LeaseDoor* const door_;
};

}  // namespace myograde::server
