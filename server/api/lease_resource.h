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
  ApiResult GetOrder(const httplib::Request& request) const;
  std::optional<ApiError> GetArtefact(const httplib::Request& request,
                                      httplib::Response& response) const;
  ApiResult TakeClaim(const httplib::Request& request) const;
  ApiResult TakeProof(const httplib::Request& request) const;
  ApiResult TakeRecords(const httplib::Request& request) const;
  ApiResult TakeLog(const httplib::Request& request) const;
  ApiResult TakeEnd(const httplib::Request& request) const;
  // Whether the caller is the node that plays it.
  std::optional<ApiError> CheckCaller(const httplib::Request& request) const;

  LeaseDoor* const door_;
};

}  // namespace myograde::server
