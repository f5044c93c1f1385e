#include "server/api/access_resource.h"

#include <functional>
#include <string>

#include "protocol/base/status_macros.h"
#include "server/api/paging.h"
#include "server/api/requests.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json AddressToJson(const Address& address) {
  return {{"method", address.method},
          {"path", PathOf(address.pattern)},
          {"action", ActionName(address.action)},
          {"role", RoleName(RoleFor(address.action))},
          {"own_team", NeedsTeam(address.action)}};
}

Json EventToJson(const AccessEventRow& event) {
  return {{"id", event.id},
          {"at", TimeToJson(event.at)},
          {"kind", event.kind},
          {"who", event.who},
          {"role", TextOrNull(event.role)},
          {"action", event.action},
          {"subject", TextOrNull(event.subject)},
          {"detail", TextOrNull(event.detail)},
          {"count", event.count}};
}

ApiResult ListAddresses(const Request& request, const Router& router) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  Json list = Json::array();
  for (const Address& address : router.addresses()) {
    if (!address.page) list.push_back(AddressToJson(address));
  }
  return ApiAnswer{200, {{"addresses", std::move(list)}}};
}

}  // namespace

void AccessResource::Install(Routes& routes) {
  using Self = AccessResource;
  routes.Get("/v1/addresses", Action::kReadApi,
             [&router = routes.router()](const Request& request) {
               return ListAddresses(request, router);
             });
  routes.Get("/v1/events", Action::kReadEvents, std::bind_front(&Self::ListEvents, this));
}

ApiResult AccessResource::ListEvents(const Request& request) const {
  absl::Status status = CheckParameters(request, {"kind", "before", "limit"});
  const std::string kind = request.Param("kind");
  if (request.HasParam("kind") && kind != "denied" && kind != "act") {
    status.Update(absl::InvalidArgumentError("\"kind\" must be denied or act"));
  }
  const absl::StatusOr<Page> page = ReadPage(request);
  status.Update(page.status());
  RETURN_IF_ERROR(status);
  ApiAnswer answer;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    const Listed<AccessEventRow> listed = reader.AccessEvents(kind, page->before, page->limit);
    Json events = Json::array();
    for (const AccessEventRow& event : listed.rows) events.push_back(EventToJson(event));
    answer.body = {{"events", std::move(events)}, {"unreadable", DamagedToJson(listed.damaged)}};
    AddNextPage(request, *page, listed, answer);
    return absl::OkStatus();
  }));
  return answer;
}

}  // namespace myograde::server
