// The HTTP API (README.md): its resources (resources.h) behind one guard.
#pragma once

#include "server/api/context.h"
#include "server/api/guard.h"
#include "server/http/http_server.h"

namespace myograde::server {

class Api {
 public:
  explicit Api(const ApiContext& context);
  Api(const Api&) = delete;
  Api& operator=(const Api&) = delete;

  // Adds every address of the API to `server`, which must not outlive it.
  void Install(HttpServer& server);

 private:
  const ApiContext context_;
  Guard guard_;
};

}  // namespace myograde::server
