#include "server/api/rejudge_plan.h"

#include <memory>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/api/board_source.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/engine/stored.h"
#include "server/proof/signing_key.h"

namespace myograde::server {
namespace {

constexpr char kWhereSent[] = "the new config";
// A submission's number.
constexpr int64_t kMostId = 999'999'999'999'999'999;

std::string ReadBoardName(ConfigReader& reader, const char* key) {
  if (!reader.Has(key)) return "";
  std::string name = reader.String(key);
  if (!IsTrackName(name)) {
    reader.Fail(key, "must be a name of 1 to 64 of the characters a-z, 0-9 and \"-\"");
  }
  return name;
}

absl::StatusOr<TrackPtr> NewTrack(const ApiContext& context, const TrackConfig& live,
                                  const Json& file) {
  ASSIGN_OR_RETURN(TrackConfig config,
                   ResolveTrackConfig(context.tracks_dir, live.id, live.profile, file, kWhereSent));
  // Checked first: another environment lacks most of this one's keys.
  if (config.kind != live.kind) {
    return absl::InvalidArgumentError(
        absl::StrCat(kWhereSent, " is for the environment \"", std::string(config.kind->name),
                     "\", but track \"", live.id, "\" is of \"", std::string(live.kind->name),
                     "\"; give a config that extends this board's track"));
  }
  if (!live.phase.empty()) {
    ASSIGN_OR_RETURN(config, WithPhase(config, KeysOfPhase(context.phases.ConfigOf(live.phase), live)));
  }
  if (config.seeds.size() != live.seeds.size()) {
    return absl::InvalidArgumentError(absl::StrCat(kWhereSent, " has ", config.seeds.size(),
                                                   " seeds and the board has ", live.seeds.size(),
                                                   "; a board keeps the number of its episodes"));
  }
  return MakeTrack(std::move(config));
}

}  // namespace

absl::StatusOr<RejudgeRequest> ParseRejudge(const Json& body) {
  ConfigReader reader(body, "request");
  RejudgeRequest request;
  BoardName& board = request.board;
  board.phase = ReadBoardName(reader, "phase");
  board.track = ReadBoardName(reader, "track");
  board.profile = ReadBoardName(reader, "profile");
  if (board.phase.empty() == board.track.empty()) {
    reader.Fail("phase", "or \"track\" must be given, but not both: the board to rejudge");
  } else if (!board.phase.empty() && !board.profile.empty()) {
    reader.Fail("profile", "is only for a track's own board; a phase has one profile");
  }
  if (reader.Has("config")) request.config = reader.Object("config");
  if (reader.Has("method")) {
    request.method = ParseEnum<RejudgeMethod>(reader.Choice("method", {"auto", "facts", "play"}))
                         .value_or(RejudgeMethod::kAuto);
  }
  if (reader.Has("repeats")) request.repeats = reader.Integer("repeats", 1, kMostRepeats);
  request.why = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return request;
}

absl::StatusOr<RejudgeAct> ParseApply(const Json& body) {
  ConfigReader reader(body, "request");
  RejudgeAct act{.why = ReadReason(reader)};
  if (reader.Has("without")) {
    for (const Json& id : reader.Array("without")) {
      if (id.is_number_integer() && id >= 1 && id <= kMostId) {
        act.without.insert(id.get<int64_t>());
      } else {
        reader.Fail("without", "must list numbers of submissions");
      }
    }
  }
  RETURN_IF_ERROR(reader.Finish());
  return act;
}

absl::StatusOr<NewRejudge> MakeRejudge(const Transaction& reader, const ApiContext& context,
                                       const RejudgeRequest& request) {
  ASSIGN_OR_RETURN(const TrackPtr live, TrackInForce(reader, context, request.board));
  TrackPtr next = live;
  if (request.config.has_value()) {
    ASSIGN_OR_RETURN(next, NewTrack(context, live->config, *request.config));
  }
  NewRejudge rejudge = RejudgeBetween(live->config, next->config);
  rejudge.method = request.method;
  rejudge.repeats = request.repeats;
  rejudge.why = request.why;
  return rejudge;
}

NewRejudge RejudgeBetween(const TrackConfig& from, const TrackConfig& to) {
  NewRejudge rejudge;
  rejudge.board = {from.phase, from.id, from.profile};
  rejudge.from_config = from.hash;
  rejudge.from_config_json = CanonicalJson(from.effective);
  rejudge.to_config = to.hash;
  rejudge.to_config_json = CanonicalJson(to.effective);
  rejudge.seeds_json = CanonicalJson(Json(to.seeds));
  rejudge.seeds = Sha256Hex(rejudge.seeds_json);
  return rejudge;
}

absl::StatusOr<SignDocument> RejudgeSigner(const ApiContext& context) {
  ASSIGN_OR_RETURN(std::shared_ptr<const SigningKey> key, context.receipts_key.Get());
  // Called on the engine's thread, which may be after the request has been answered.
  return [key = std::move(key)](const std::string& document) { return key->Sign(document); };
}

}  // namespace myograde::server
