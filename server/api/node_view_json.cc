#include "server/api/node_view_json.h"

#include <map>
#include <string>
#include <utility>

#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json NodeToJson(const NodeView& node, const DrainedNodeRow* drained) {
  return {{"node", node.name},
          {"state", node.state},
          {"reason", TextOrNull(node.why)},
          {"drained_at", drained == nullptr ? Json() : TimeToJson(drained->at)},
          {"drained_by", drained == nullptr ? Json() : Json(drained->who)},
          {"processor", TextOrNull(node.processor)},
          {"running", node.running},
          {"done", node.done},
          {"faults", node.faults}};
}

}  // namespace

nlohmann::json NodesToJson(const std::vector<NodeView>& known,
                           const std::vector<DrainedNodeRow>& drained, bool remote) {
  std::map<std::string, const DrainedNodeRow*> rows;
  for (const DrainedNodeRow& row : drained) rows[row.node] = &row;
  std::map<std::string, NodeView> nodes;
  for (const NodeView& node : known) nodes[node.name] = node;
  if (remote) {
    for (const DrainedNodeRow& row : drained) {
      NodeView met;
      met.name = row.node;
      met.state = "drained";
      met.why = row.why;
      nodes.try_emplace(row.node, std::move(met));
    }
  }
  Json list = Json::array();
  for (const auto& [name, node] : nodes) {
    const auto row = rows.find(name);
    const bool is_drained = node.state == "drained" && row != rows.end();
    list.push_back(NodeToJson(node, is_drained ? row->second : nullptr));
  }
  return list;
}

}  // namespace myograde::server
