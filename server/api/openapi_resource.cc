#include "server/api/openapi_resource.h"

#include <memory>
#include <string>

#include "server/api/openapi/document.h"
#include "server/api/requests.h"

namespace myograde::server {

void OpenApiResource::Install(Routes& routes) {
  const auto document = std::make_shared<const std::string>(OpenApiDocument());
  routes.Get("/v1/openapi.json", Action::kReadApi, [document](const Request& request) -> ApiResult {
    if (absl::Status status = CheckParameters(request, {}); !status.ok()) return ErrorOf(status);
    return ApiAnswer{.text = document, .tagged = true};
  });
}

}  // namespace myograde::server
