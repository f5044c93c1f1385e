// The webhooks of server.json: how their deliveries stand, and a test of one.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class WebhooksResource {
 public:
  // `context` must outlive it.
  explicit WebhooksResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Test(const Request& request, const nlohmann::json& body) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
