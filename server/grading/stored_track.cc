#include "server/grading/stored_track.h"

#include <utility>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

absl::Status UnreadableConfig(const std::string& hash, const absl::Status& why) {
  return DamagedRow({"config", hash, std::string(why.message())});
}

}  // namespace

absl::StatusOr<TrackConfig> StoredConfig(Reader& reader, const std::string& hash) {
  ASSIGN_OR_RETURN(std::string text, reader.ConfigJson(hash));
  absl::StatusOr<nlohmann::json> json = ParseJson(text, "its content");
  if (!json.ok()) return UnreadableConfig(hash, json.status());
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(*json, "its content");
  if (!config.ok()) return UnreadableConfig(hash, config.status());
  return config;
}

absl::StatusOr<TrackPtr> StoredTrack(Reader& reader, const std::string& hash) {
  ASSIGN_OR_RETURN(TrackConfig config, StoredConfig(reader, hash));
  absl::StatusOr<TrackPtr> track = MakeTrack(std::move(config));
  if (!track.ok()) return UnreadableConfig(hash, track.status());
  return track;
}

}  // namespace myograde::server
