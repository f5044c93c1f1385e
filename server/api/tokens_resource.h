// Bearer tokens: making, listing and revoking them.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class TokensResource {
 public:
  // `context` must outlive it.
  explicit TokensResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Create(const Request& request, const nlohmann::json& body) const;
  ApiResult List(const Request& request) const;
  ApiResult Revoke(const Request& request, const nlohmann::json& body) const;
  // The token as it is in the store.
  ApiResult Show(int64_t id, int http, nlohmann::json more) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
