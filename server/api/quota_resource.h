// What a team may still hand in, its ledger, and the organiser's grants.
#pragma once

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class QuotaResource {
 public:
  // `context` must outlive it.
  explicit QuotaResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Get(const Request& request) const;
  ApiResult Grant(const Request& request, const nlohmann::json& body) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
