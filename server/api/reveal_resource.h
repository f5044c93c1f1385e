// The reveal of the seeds that a phase was committed to.
#pragma once

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class RevealResource {
 public:
  // `context` must outlive it.
  explicit RevealResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Reveal(const Request& request, const nlohmann::json& body) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
