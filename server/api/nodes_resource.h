// The nodes of the cluster that leases run on.
#pragma once

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class NodesResource {
 public:
  // `context` must outlive it.
  explicit NodesResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Set(const Request& request, const nlohmann::json& body) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
