// Who the server takes the caller for.
#pragma once

#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class WhoamiResource {
 public:
  void Install(Routes& routes);

 private:
  ApiResult Whoami(const httplib::Request& request) const;
};

}  // namespace myograde::server
