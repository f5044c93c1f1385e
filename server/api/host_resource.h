// The daemon's health, and the tracks that it grades.
#pragma once

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class HostResource {
 public:
  // `context` must outlive it.
  explicit HostResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Health(const Request& request) const;
  // Whether the process serves requests, and whether it can do its work.
  ApiResult Live(const Request& request) const;
  ApiResult Ready(const Request& request) const;
  // What organisers see beside.
  nlohmann::json HostToJson(const LiveHealth& health) const;
  ApiResult ListTracks(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
