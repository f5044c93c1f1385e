#include "server/api/whoami_resource.h"

#include <functional>

#include "protocol/base/status_macros.h"
#include "server/api/requests.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

}  // namespace

void WhoamiResource::Install(Routes& routes) {
  routes.Get("/v1/whoami", Action::kReadApi, std::bind_front(&WhoamiResource::Whoami, this));
}

ApiResult WhoamiResource::Whoami(const Request& request) const {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  const Identity& caller = Caller();
  Json token;
  if (caller.token != 0) {
    RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
      const absl::StatusOr<TokenRow> row = reader.Token(caller.token);
      if (row.ok()) {
        token = {{"id", row->id},
                 {"label", row->label},
                 {"expires_at", TimeToJson(row->expires_at)}};
      }
      return row.status();
    }));
  }
  return ApiAnswer{200,
                   {{"role", RoleName(caller.role)},
                    {"teams", caller.teams},
                    {"token", std::move(token)},
                    {"caller", caller.key},
                    {"remote", caller.remote}}};
}

}  // namespace myograde::server
