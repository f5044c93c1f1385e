#include "server/grading/lease_use.h"

#include <algorithm>
#include <map>
#include <string>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

}  // namespace

void AddStartUp(const std::vector<EpisodeRow>& rows, int64_t first, int64_t last, Json& use) {
  std::map<std::string, double> rest;
  for (const char* key : {"policy_cpu_s", "wall_s"}) {
    if (const Json total = use.value(key, Json()); total.is_number()) rest[key] = total.get<double>();
  }
  for (const EpisodeRow& row : rows) {
    if (row.index < first || row.index > last) continue;
    const Json facts = Json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
    if (!facts.is_object()) continue;
    for (auto& [key, left] : rest) {
      if (const Json part = facts.value(key, Json()); part.is_number()) left -= part.get<double>();
    }
  }
  for (const auto& [key, left] : rest) {
    use[key == "wall_s" ? "startup_wall_s" : "startup_cpu_s"] = std::max(left, 0.0);
  }
}

}  // namespace myograde::server
