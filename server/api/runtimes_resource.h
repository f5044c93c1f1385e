// The runtimes that submissions may ask for.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class RuntimesResource {
 public:
  // `context` must outlive it.
  explicit RuntimesResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
