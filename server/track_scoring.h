// The `scoring` section of a track config as scoring's own values.
#pragma once

#include <map>
#include <string>
#include <variant>

#include <absl/status/statusor.h>

#include "protocol/track_config.h"
#include "scoring/board.h"
#include "scoring/judge.h"

namespace myograde::server {

// The board that every track has.
inline constexpr char kMainBoard[] = "main";

struct TrackScoring {
  std::variant<scoring::ManipulationJudging, scoring::LocomotionJudging> judging;
  scoring::TeamRule team = scoring::TeamRule::kBest;
  // By name: "main"; locomotion also "physiological".
  std::map<std::string, scoring::BoardRules> boards;
};

// Errors name the config, the key and its range; unknown keys are errors.
absl::StatusOr<TrackScoring> ParseTrackScoring(const TrackConfig& config);

// True if the profile reports what the official code reports, so that its figures are for
// comparing with those that were published of it.
bool HasOfficialFigures(const TrackConfig& config);

// The verdict on an episode by the rules of its track.
scoring::Judgement JudgeEpisode(const TrackScoring& track, const EpisodeFacts& facts);

}  // namespace myograde::server
