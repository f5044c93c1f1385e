// The log of an episode, in SQL. Internal to the store.
#pragma once

namespace myograde::server {

// The hash of an episode's log, "" if it has none, NULL if its facts are unreadable. The same
// expression as in the index episode_by_log (schema_v4.sql), so that the index is used.
inline constexpr char kLogOfEpisode[] =
    "CASE WHEN typeof(facts_json) = 'text' AND json_valid(facts_json) "
    "THEN ifnull(json_extract(facts_json, '$.log.sha256'), '') END";

}  // namespace myograde::server
