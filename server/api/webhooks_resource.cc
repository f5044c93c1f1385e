#include "server/api/resources.h"

#include <algorithm>
#include <map>

#include <absl/strings/str_cat.h>

#include "server/http/http_server.h"

namespace myograde::server {
namespace {

// Of each webhook; GET /metrics has counts of all.
constexpr int64_t kShownDeliveries = 20;
// Of a request's time, what a test may take.
constexpr double kTestShare = 0.8;

ApiResult ListWebhooks(const ApiContext& context, const Transaction& reader,
                       const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  Json list = Json::array();
  std::map<std::string, DeliveryCounts> counts;
  for (DeliveryCounts& count : reader.deliveries.Counts()) counts[count.webhook] = count;
  for (const Webhook& webhook : context.webhooks.webhooks()) {
    const std::string& name = webhook.config.name;
    Json deliveries = Json::array();
    for (const DeliveryRow& row : reader.deliveries.List(name, INT64_MAX, kShownDeliveries).rows) {
      deliveries.push_back(
          {{"delivery", row.id},
           {"event", row.event},
           {"at", TimeToJson(row.at)},
           {"state", row.state},
           {"attempts", row.attempts},
           {"next_attempt_at", row.state == "waiting" ? TimeToJson(row.due_at) : Json()},
           {"problem", TextOrNull(row.detail)}});
    }
    list.push_back({{"webhook", name},
                    {"url", webhook.config.url},
                    {"events", webhook.config.events},
                    {"waiting", counts[name].waiting},
                    {"delivered", counts[name].delivered},
                    {"given_up", counts[name].given_up},
                    {"oldest_waiting_at", TimeToJson(counts[name].oldest_waiting_at)},
                    {"deliveries", std::move(deliveries)}});
  }
  return ApiAnswer{200, {{"webhooks", std::move(list)}}};
}

ApiResult TestWebhook(const ApiContext& context, const Request& request, const Json& body) {
  RETURN_IF_ERROR(ParseNothing(body));
  const std::string name = request.matches[1];
  const Webhook* configured = context.webhooks.Find(name);
  if (configured == nullptr) {
    return absl::NotFoundError(absl::StrCat("server.json has no webhook \"", name, "\""));
  }
  Webhook webhook = *configured;
  webhook.config.timeout =
      std::min(webhook.config.timeout, context.config.http.request * kTestShare);
  const absl::Duration begin = context.clock.Monotonic();
  ASSIGN_OR_RETURN(const PostResult result,
                   context.webhooks.Test(webhook, [] { return HttpServer::Stopping(); }));
  NoteAct(absl::StrCat("webhook ", name), result.delivered ? "delivered" : "not delivered");
  return ApiAnswer{200,
                   {{"webhook", name},
                    {"delivered", result.delivered},
                    {"status", result.http == 0 ? Json() : Json(result.http)},
                    {"problem", TextOrNull(result.problem)},
                    {"took_wall_s", absl::ToDoubleSeconds(context.clock.Monotonic() - begin)}}};
}

}  // namespace

void AddWebhooks(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/webhooks", Action::kManageWebhooks, Bind(context, ListWebhooks));
  routes.Post(R"(/v1/webhooks/([A-Za-z0-9._-]{1,64})/test)", Action::kManageWebhooks,
              Bind(context, TestWebhook));
}

}  // namespace myograde::server
