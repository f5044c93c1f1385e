#include "server/api/nodes_resource.h"

#include <functional>
#include <map>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/api/node_view_json.h"
#include "server/api/requests.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Names that Slurm and DNS have for hosts.
constexpr char kNode[] = R"(/v1/nodes/([A-Za-z0-9][A-Za-z0-9._-]{0,254}))";

struct NodeAct {
  bool drain = false;
  std::string why;  // "" for an admission
};

absl::StatusOr<NodeAct> ParseNodeAct(const Json& body) {
  ConfigReader reader(body, "request");
  NodeAct act;
  act.drain = reader.Choice("state", {"drained", "admitted"}) == "drained";
  if (act.drain) act.why = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return act;
}

}  // namespace

void NodesResource::Install(Routes& routes) {
  routes.Get("/v1/nodes", Action::kReadHost, std::bind_front(&NodesResource::List, this));
  routes.Post(kNode, Action::kManageNodes, std::bind_front(&NodesResource::Set, this));
}

ApiResult NodesResource::List(const Request& request) const {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  Listed<DrainedNodeRow> drained;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    drained = reader.DrainedNodes();
    return absl::OkStatus();
  }));
  const bool cluster = context_.config.on_cluster;
  return ApiAnswer{200,
                   {{"cluster", cluster},
                    {"message", TextOrNull(context_.engine.Health().executor_trouble)},
                    {"nodes", NodesToJson(context_.engine.Nodes(), drained.rows, cluster)},
                    {"unreadable", DamagedToJson(drained.damaged)}}};
}

ApiResult NodesResource::Set(const Request& request, const Json& body) const {
  ASSIGN_OR_RETURN(const NodeAct act, ParseNodeAct(body));
  if (!context_.config.on_cluster) {
    return StatusOf({409, "no_cluster",
                    "leases run on this host, so there are no nodes; \"executor\" of server.json "
                    "says where they run"});
  }
  const std::string node = request.matches[1];
  const absl::Duration timeout = context_.config.http.request;
  const absl::Status status =
      act.drain ? context_.engine.DrainNode(node, act.why, CallerKey(), timeout)
                 : context_.engine.AdmitNode(node, CallerKey(), timeout);
  RETURN_IF_ERROR(status);
  NoteAct(absl::StrCat("node ", node),
          act.drain ? absl::StrCat("drained: ", act.why) : std::string("admitted"));
  return ApiAnswer{200, {{"node", node}, {"state", act.drain ? "drained" : "admitted"}}};
}

}  // namespace myograde::server
