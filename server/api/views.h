// The parts of the API's answers that more than one address tells.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "server/grading/tracks.h"
#include "server/store/damage.h"
#include "server/store/rows.h"

namespace myograde::server {

// UTC with milliseconds; null for 0 ("not yet").
nlohmann::json TimeToJson(int64_t ms);
// Of what a list could not show: [{"table": "episode", "key": "7/3", "message": "…"}].
nlohmann::json DamagedToJson(const std::vector<Damage>& damaged);
// Null for "".
nlohmann::json TextOrNull(const std::string& text);
nlohmann::json SecondsOrNull(const std::optional<absl::Duration>& duration);
nlohmann::json CountsToJson(int64_t total, const EpisodeCounts& counts);
// One row of `episode_rows`; with the salt of a config that hides its seeds (not ""), it has
// "seed_commitment", too.
nlohmann::json EpisodeToJson(const EpisodeRow& row, const std::string& seed_salt);
// Changes of a submission's marks, oldest first.
nlohmann::json MarksToJson(const std::vector<MarkRow>& rows);
// What a participant may use, as in the track's config.
nlohmann::json LimitsToJson(const TrackConfig& config);
// A re-run against its original; both sorted by index.
nlohmann::json CompareRows(int64_t original, const std::vector<EpisodeRow>& original_rows,
                           const EvaluationRow& rerun, const std::vector<EpisodeRow>& rerun_rows);
// Null for 0: none.
nlohmann::json IdOrNull(int64_t id);

}  // namespace myograde::server
