// Who the server takes the caller for.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class WhoamiResource {
 public:
  // `context` must outlive it.
  explicit WhoamiResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Whoami(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
