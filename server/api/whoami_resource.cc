#include "server/api/whoami_resource.h"

#include <functional>
#include <string>

#include "server/access/access.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Role RoleOf(const Peer& caller) {
  if (caller.organiser) return Role::kOperator;
  return caller.network ? Role::kPublic : Role::kParticipant;
}

}  // namespace

void WhoamiResource::Install(Routes& routes) {
  routes.Get("/v1/whoami", std::bind_front(&WhoamiResource::Whoami, this));
}

ApiResult WhoamiResource::Whoami(const httplib::Request&) const {
  const Peer caller = UnixHttpServer::Caller();
  return ApiAnswer{200,
                   {{"role", std::string(RoleName(RoleOf(caller)))},
                    {"teams", Json::array()},
                    {"token", nullptr},
                    {"caller", caller.key},
                    {"remote", caller.network}}};
}

}  // namespace myograde::server
