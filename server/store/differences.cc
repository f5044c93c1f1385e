#include "server/store/differences.h"

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/lease/seed_commitment.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Facts without the clocks. Text that is not JSON is compared as it is, so that damaged rows differ
// instead of stopping the daemon.
Json Parse(const std::string& text) {
  Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_discarded() ? Json(text) : json;
}

// Removes a key from an object and returns its canonical text: equal bytes mean equal values.
std::string Take(Json& object, const char* key) {
  if (!object.is_object() || !object.contains(key)) return "";
  const std::string text = CanonicalJson(object[key]);
  object.erase(key);
  return text;
}

}  // namespace

std::vector<std::string> DifferencesBetween(const EpisodeRow& a, const EpisodeRow& b) {
  std::vector<std::string> differs;
  if (a.seed != b.seed) differs.push_back("seed");
  if (a.outcome != b.outcome) differs.push_back("outcome");
  if (a.reason != b.reason) differs.push_back("reason");
  if (a.metrics_json != b.metrics_json) differs.push_back("metrics");
  Json facts_a = Parse(a.facts_json);
  Json facts_b = Parse(b.facts_json);
  for (const char* clock : {"wall_s", "policy_cpu_s"}) {
    Take(facts_a, clock);
    Take(facts_b, clock);
  }
  for (const char* key : {"steps", "sim_time", "clipped"}) {
    if (Take(facts_a, key) != Take(facts_b, key)) differs.push_back(key);
  }
  if (Take(facts_a, "actions_digest") != Take(facts_b, "actions_digest")) {
    differs.push_back("actions");
  }
  const bool digest_differs = Take(facts_a, "digest") != Take(facts_b, "digest");
  // A fault's evidence may hold a measured time; its outcome is compared above.
  for (Json* facts : {&facts_a, &facts_b}) {
    Take(*facts, "fault");
    Take(*facts, "log");  // follows from what is compared, and may have been truncated
    Take(*facts, "seed");
  }
  if (CanonicalJson(facts_a) != CanonicalJson(facts_b)) differs.push_back("facts");
  if (digest_differs) differs.push_back("digest");
  return differs;
}

std::string CanonicalResult(const EpisodeRow& row, const std::string& seed_salt) {
  Json facts = Parse(row.facts_json);
  const Json steps = facts.is_object() && facts.contains("steps") ? facts["steps"] : Json();
  const Json digest = facts.is_object() && facts.contains("digest") ? facts["digest"] : Json();
  Json result = {{"index", row.index},
                 {"outcome", OutcomeName(row.outcome)},
                 {"reason", row.reason.name()},
                 {"metrics", Parse(row.metrics_json)},
                 {"steps", steps},
                 {"digest", digest}};
  if (seed_salt.empty()) {
    result["seed"] = row.seed;
  } else {
    result["seed_commitment"] = SeedCommitment(seed_salt, row.index, row.seed);
  }
  return CanonicalJson(result);
}

}  // namespace myograde::server
