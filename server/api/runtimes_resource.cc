#include "server/api/runtimes_resource.h"

#include <functional>
#include <utility>

#include "protocol/base/status_macros.h"
#include "server/api/requests.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {

void RuntimesResource::Install(Routes& routes) {
  routes.Get("/v1/runtimes", Action::kReadTracks, std::bind_front(&RuntimesResource::List, this));
}

ApiResult RuntimesResource::List(const Request& request) const {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  nlohmann::json runtimes = nlohmann::json::array();
  for (const Runtime& runtime :
       Runtimes(context_.config.runtimes, context_.config.runtimes_dir).List()) {
    runtimes.push_back(RuntimeToJson(runtime));
  }
  return ApiAnswer{.body = {{"runtimes", std::move(runtimes)}}, .tagged = true};
}

}  // namespace myograde::server
