#include "server/api/openapi_resource.h"

#include <memory>
#include <string>

#include "protocol/base/status_macros.h"
#include "server/api/openapi/document.h"
#include "server/api/requests.h"

namespace myograde::server {

void OpenApiResource::Install(Routes& routes) {
  const auto document = std::make_shared<const std::string>(OpenApiDocument());
  routes.Get("/v1/openapi.json", Action::kReadApi, [document](const Request& request) -> ApiResult {
    RETURN_IF_ERROR(CheckParameters(request, {}));
    return ApiAnswer{.text = document, .tagged = true};
  });
}

}  // namespace myograde::server
