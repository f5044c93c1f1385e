#include "server/grading/lease_use.h"

#include <algorithm>

#include <nlohmann/json.hpp>

namespace myograde::server {

double StartUpCpu(double lease_cpu_s, const std::vector<EpisodeRow>& rows, int64_t first,
                  int64_t last) {
  double rest = lease_cpu_s;
  for (const EpisodeRow& row : rows) {
    if (row.index < first || row.index > last) continue;
    const auto facts = nlohmann::json::parse(row.facts_json, nullptr, /*allow_exceptions=*/false);
    const auto cpu = facts.is_object() ? facts.find("policy_cpu_s") : facts.end();
    if (facts.is_object() && cpu != facts.end() && cpu->is_number()) rest -= cpu->get<double>();
  }
  return std::max(rest, 0.0);
}

}  // namespace myograde::server
