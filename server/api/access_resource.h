// Who may do what, and who did or tried what.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class AccessResource {
 public:
  // `context` must outlive it.
  explicit AccessResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult ListEvents(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
