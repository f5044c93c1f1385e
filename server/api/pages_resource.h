// The web pages, for everybody: what they show, they ask the API for, with their reader's rights.
#pragma once

#include "server/api/routes.h"

namespace myograde::server {

class PagesResource {
 public:
  void Install(Routes& routes);
};

}  // namespace myograde::server
