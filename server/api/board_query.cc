#include "server/api/board_query.h"

#include <absl/strings/str_cat.h>

#include "server/api/requests.h"
#include "server/engine/stored.h"

namespace myograde::server {
namespace {

// A phase that no file describes any more is found by its submissions.
absl::StatusOr<TrackPtr> TrackOfPhase(Reader& reader, const ApiContext& context,
                                      const std::string& name) {
  const absl::StatusOr<PhasePtr> phase = context.phases.Find(name);
  if (phase.ok()) return (*phase)->track;
  const std::string config = reader.ConfigOfPhase(name);
  if (config.empty()) return phase.status();
  return StoredTrack(reader, config);
}

absl::StatusOr<TrackPtr> AskedTrack(const httplib::Request& request, Reader& reader,
                                    const ApiContext& context) {
  const std::string name = request.get_param_value("track");
  const std::string profile = request.get_param_value("profile");
  if (!request.has_param("phase")) {
    if (request.has_param("track")) return context.tracks.Find(name, profile);
    return absl::InvalidArgumentError(
        "\"track\" is missing: a board is of one track, or of one \"phase\"");
  }
  absl::StatusOr<TrackPtr> track =
      TrackOfPhase(reader, context, request.get_param_value("phase"));
  if (!track.ok()) return track.status();
  const TrackConfig& config = (*track)->config;
  if ((name.empty() || name == config.id) && (profile.empty() || profile == config.profile)) {
    return track;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("phase \"", config.phase, "\" is of track \"", config.id,
                   "\" in the profile \"", config.profile, "\""));
}

// From a phase's freeze on, only organisers see what ends later.
absl::Status AddFreeze(Reader& reader, const ApiContext& context, BoardQuery& asked) {
  const PhaseConfig* phase = context.phases.ConfigOf(asked.track->config.phase);
  if (phase == nullptr) return absl::OkStatus();
  const auto events = reader.PhaseEvents(phase->name);
  if (!events.ok()) return events.status();
  const PhaseStatus status = StatusOfPhase(*phase, *events, context.clock.Now());
  const bool ever = phase->freezes != absl::InfiniteFuture();
  if (!ever || status.published || status.revealed) return absl::OkStatus();
  asked.freezes = phase->freezes;
  asked.frozen = status.frozen;
  asked.whole = CallerIsOrganiser();
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoardQuery> ParseBoardQuery(const httplib::Request& request, Reader& reader,
                                           const ApiContext& context) {
  absl::StatusOr<TrackPtr> track = AskedTrack(request, reader, context);
  if (!track.ok()) return track.status();
  BoardQuery asked{*track, request.has_param("board") ? request.get_param_value("board")
                                                      : scoring::kMainBoard};
  const auto rules = asked.track->scoring.boards.find(asked.board);
  if (rules == asked.track->scoring.boards.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("track \"", asked.track->config.id, "\" has no board \"", asked.board, "\""));
  }
  asked.rules = &rules->second;
  if (absl::Status status = AddFreeze(reader, context, asked); !status.ok()) return status;
  return asked;
}

}  // namespace myograde::server
