// The web pages, for everybody: what they show, they ask the API for, with their reader's rights.
#pragma once

#include "server/api/documents.h"
#include "server/api/routes.h"

namespace myograde::server {

class PagesResource {
 public:
  // `documents` is what stands under /docs; it must outlive this.
  explicit PagesResource(const Documents& documents) : documents_(documents) {}

  void Install(Routes& routes);

 private:
  void ServeDocument(const Request& request, Response& response) const;

  const Documents& documents_;
};

}  // namespace myograde::server
