#include "server/grading/lease_use.h"

#include <algorithm>
#include <utility>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

}  // namespace

void AddStartUp(const std::vector<EpisodeRow>& rows, int64_t first, int64_t last, Json& use) {
  for (const auto& [whole, start] : {std::pair("policy_cpu_s", "startup_cpu_s"),
                                     std::pair("wall_s", "startup_wall_s")}) {
    const Json total = use.value(whole, Json());
    if (!total.is_number()) continue;
    auto rest = total.get<double>();
    for (const EpisodeRow& row : rows) {
      if (row.index < first || row.index > last) continue;
      const Json facts = Json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
      const Json part = facts.is_object() ? facts.value(whole, Json()) : Json();
      if (part.is_number()) rest -= part.get<double>();
    }
    use[start] = std::max(rest, 0.0);
  }
}

}  // namespace myograde::server
