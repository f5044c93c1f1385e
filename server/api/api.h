// The HTTP API (README.md): its resources (resources.h) behind one guard.
#pragma once

#include "server/api/context.h"
#include "server/api/guard.h"
#include "server/http/http_server.h"

namespace myograde::server {

class Api {
 public:
  // Adds every address of the API to `server`, which must not outlive it.
  Api(const ApiContext& context, HttpServer& server);
  Api(const Api&) = delete;
  Api& operator=(const Api&) = delete;

 private:
  const ApiContext context_;
  Guard guard_;
};

}  // namespace myograde::server
