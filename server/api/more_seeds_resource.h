// Further episodes for places that a phase's own episodes do not decide.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class MoreSeedsResource {
 public:
  // `context` must outlive it.
  explicit MoreSeedsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult Play(const Request& request, const nlohmann::json& body) const;

  // The secret of a phase. One whose own seeds are public gets one for its further seeds.
  absl::StatusOr<std::string> SecretOf(const std::string& phase) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
