// Who may do what, and who did or tried what.
#pragma once

#include "server/api/context.h"
#include "server/api/guard.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class AccessResource {
 public:
  // Both must outlive it.
  AccessResource(const ApiContext& context, const Guard& guard)
      : context_(context), guard_(guard) {}

  void Install(Routes& routes);

 private:
  ApiResult ListAddresses(const httplib::Request& request) const;
  ApiResult ListEvents(const httplib::Request& request) const;

  const ApiContext& context_;
  const Guard& guard_;
};

}  // namespace myograde::server
