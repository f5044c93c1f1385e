#include "server/grading/tracks.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/store/store.h"

namespace myograde::server {

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

absl::StatusOr<TrackPtr> StoredTrack(const Transaction& reader, const std::string& hash) {
  ASSIGN_OR_RETURN(const std::string text, reader.content.Text(kConfigs, hash));
  const auto read = [&]() -> absl::StatusOr<TrackPtr> {
    ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, "its content"));
    ASSIGN_OR_RETURN(TrackConfig config, ParseTrackConfig(json, "its content"));
    return MakeTrack(std::move(config));
  };
  absl::StatusOr<TrackPtr> track = read();
  if (!track.ok()) return DamagedRow({kConfigs, hash, std::string(track.status().message())});
  return track;
}

}  // namespace myograde::server
