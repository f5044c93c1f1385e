// The API's own description.
#pragma once

#include "server/api/routes.h"

namespace myograde::server {

class OpenApiResource {
 public:
  void Install(Routes& routes);
};

}  // namespace myograde::server
