#include "server/executor/slurm/cluster_order.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kWhere[] = "a cluster's order";

}  // namespace

std::string ClusterOrderToText(const ClusterOrder& order) {
  Json runtimes = Json::array();
  for (const ClusterRuntime& runtime : order.runtimes) {
    runtimes.push_back({{"name", runtime.name}, {"digest", runtime.digest}});
  }
  return Json({{"order", LeaseOrderToJson(order.order)},
               {"artefact", order.artefact},
               {"runtimes", std::move(runtimes)},
               {"grader", order.grader},
               {"uid_base", order.uid_base},
               {"prove_again", order.prove_again},
               {"comment", order.comment},
               {"srun", order.srun},
               {"squeue", order.squeue},
               {"queue_wait_s", absl::ToDoubleSeconds(order.queue_wait)}})
      .dump();
}

absl::StatusOr<ClusterOrder> ClusterOrderFromText(std::string_view text) {
  ASSIGN_OR_RETURN(const Json json, ParseJson(text, kWhere));
  ConfigReader reader(json, kWhere);
  ClusterOrder order;
  const Json& lease = reader.Object("order");
  order.artefact = reader.String("artefact");
  for (const Json& entry : reader.Array("runtimes")) {
    ConfigReader runtime(entry, absl::StrCat(kWhere, ": runtimes"));
    order.runtimes.push_back({runtime.String("name"), runtime.String("digest")});
    RETURN_IF_ERROR(runtime.Finish());
  }
  order.grader = reader.String("grader");
  order.uid_base = reader.Integer("uid_base", -1, INT32_MAX);
  order.prove_again = reader.Strings("prove_again");
  order.comment = reader.String("comment");
  order.srun = reader.Strings("srun");
  order.squeue = reader.Strings("squeue");
  order.queue_wait = absl::Seconds(reader.Number("queue_wait_s", {0, 1e9}));
  RETURN_IF_ERROR(reader.Finish());
  ASSIGN_OR_RETURN(order.order, LeaseOrderFromJson(lease, absl::StrCat(kWhere, ": order")));
  if (order.runtimes.size() != order.order.runtimes.size()) {
    return absl::InvalidArgumentError(absl::StrCat(kWhere, ": runtimes: not those of its lease"));
  }
  if (!IsSha256Hex(order.artefact)) {
    return absl::InvalidArgumentError(absl::StrCat(kWhere, ": artefact: is no digest"));
  }
  return order;
}

}  // namespace myograde::server
