// Uploads of archives.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class ArtefactsResource {
 public:
  // `context` must outlive it.
  explicit ArtefactsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Upload(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
