#include "server/config/earlier_versions.h"

namespace myograde::server {
namespace {

// A test compares these with configs/server.json.
constexpr char kLaterParts[] = R"({
  "pin_slots": true,
  "scheduler": {"team_running": 1024, "queue_wait_s": 3600, "suspect_after": 2, "self_test_s": 150,
                "self_test_every_s": 180},
  "artefacts": {"unpack_memory_bytes": 1073741824},
  "quota": {"official_per_day": 100, "official_total": 1000, "practice_per_day": 1000,
            "practice_total": 100000, "failed_per_day": 100, "failed_total": 10000, "waiting": 200,
            "same_artefact": "team", "tracks": {}},
  "retention": {"artefact_days": 365, "artefact_bytes": 1099511627776, "log_days": 90,
                "log_bytes": 1099511627776, "every_s": 3600}
})";

}  // namespace

nlohmann::json WithLaterParts(nlohmann::json json) {
  if (!json.is_object()) return json;
  const nlohmann::json later = nlohmann::json::parse(kLaterParts);
  for (const auto& [name, part] : later.items()) {
    // These two were there from the first version on, and got further keys.
    const bool grew = name == "scheduler" || name == "artefacts";
    if (!json.contains(name)) {
      if (!grew) json[name] = part;
    } else if (grew && json[name].is_object()) {
      for (const auto& [key, value] : part.items()) {
        if (!json[name].contains(key)) json[name][key] = value;
      }
    }
  }
  return json;
}

}  // namespace myograde::server
