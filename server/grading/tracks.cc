#include "server/grading/tracks.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

absl::Status UnreadableConfig(const std::string& hash, const absl::Status& why) {
  return DamagedRow({"config", hash, std::string(why.message())});
}

}  // namespace

absl::StatusOr<TrackPtr> MakeTrack(TrackConfig config) {
  const scoring::ScoredTrack* track = scoring::FindScoredTrack(config.kind->name);
  if (track == nullptr) {
    return absl::InternalError(absl::StrCat("track config ", config.id, ": its track is in the "
                                            "registry of the protocol, and not in scoring's"));
  }
  ASSIGN_OR_RETURN(
      scoring::TrackScoring scoring,
      track->parse(config.scoring, absl::StrCat("track config ", config.id, " (profile ",
                                                config.profile, "): scoring")));
  return std::make_shared<const Track>(Track{std::move(config), std::move(scoring)});
}

absl::StatusOr<TrackConfig> StoredConfig(const Transaction& reader, const std::string& hash) {
  ASSIGN_OR_RETURN(std::string text, reader.content.ConfigJson(hash));
  absl::StatusOr<nlohmann::json> json = ParseJson(text, "its content");
  if (!json.ok()) return UnreadableConfig(hash, json.status());
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(*json, "its content");
  if (!config.ok()) return UnreadableConfig(hash, config.status());
  return config;
}

absl::StatusOr<TrackPtr> StoredTrack(const Transaction& reader, const std::string& hash) {
  ASSIGN_OR_RETURN(TrackConfig config, StoredConfig(reader, hash));
  absl::StatusOr<TrackPtr> track = MakeTrack(std::move(config));
  if (!track.ok()) return UnreadableConfig(hash, track.status());
  return track;
}

}  // namespace myograde::server
