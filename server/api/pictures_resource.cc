#include "server/api/resources.h"

#include <unistd.h>

#include <algorithm>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/registry.h"
#include "server/api/board_source.h"
#include "server/api/episode_rows.h"
#include "server/api/kept_boards.h"
#include "server/api/negotiation.h"
#include "server/api/redaction.h"
#include "server/base/error_code.h"
#include "server/grading/results.h"
#include "server/pictures/packing.h"
#include "server/pictures/pictures.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

constexpr int kAskAgainSeconds = 1;

// There is no such log, or none for this caller.
absl::Status MissingLog(const std::string& hash) {
  return absl::NotFoundError(
      absl::StrCat("there is no log ", hash, " on this server; it was never kept, or was removed"));
}

// Whether the caller may see a log: one of their teams' episodes has it, and its phase shows logs.
// MissingLog, or an error with the code "withheld". Organisers may see every one.
absl::Status RequireShownLog(const ApiContext& context, const std::string& hash) {
  if (CallerIsOrganiser()) return absl::OkStatus();
  return context.readers.Read([&](const Transaction& reader) -> absl::Status {
    // Two teams have the same log if they submitted the same policy.
    const auto teams = reader.episodes.TeamsOfLog(hash);
    if (teams.empty()) return MissingLog(hash);
    const auto own = std::find_if(teams.begin(), teams.end(), [](const auto& team) {
      return Caller().teams.contains(team.first);
    });
    RETURN_IF_ERROR(
        Require(own == teams.end() ? teams.begin()->first : own->first, MissingLog(hash)));
    // A log holds its episode's seed. Equal logs are of one phase, as they hold their config.
    for (const auto& [team, phases] : teams) {
      for (const std::string& phase : phases) {
        if (SeesLogs(FindPhaseVisibility(reader, context, phase))) continue;
        return WithheldError(
            absl::StrCat("phase \"", phase, "\" withholds the logs of its episodes"));
      }
    }
    return absl::OkStatus();
  });
}

// The replays that everybody may watch, one for each main board that has one. Safe from any thread.
class PublicReplays {
 public:
  // `context` must outlive it.
  explicit PublicReplays(const ApiContext& context) : context_(context) {}

  // Boards that can't be read or have none are left out.
  Json List(const Transaction& reader) {
    Json list = Json::array();
    const auto add = [&](const TrackPtr& live) {
      const absl::StatusOr<KeptBoards::Text> text = Of(reader, live);
      if (text.ok() && !(*text)->empty()) list.push_back(Json::parse(**text));
    };
    for (const PhasePtr& phase : context_.phases.entries()) add(phase->track);
    for (const auto& [name, offer] : context_.tracks.entries()) {
      add(offer.profiles.at(offer.default_profile));
    }
    return list;
  }

  // MissingLog unless the list has the log's episode.
  absl::Status Require(const Transaction& reader, const std::string& log) {
    for (const Json& replay : List(reader)) {
      if (replay["log"] == log) return absl::OkStatus();
    }
    return MissingLog(log);
  }

 private:
  // What the list has of a board, kept until the store changes; "": nothing.
  absl::StatusOr<KeptBoards::Text> Of(const Transaction& reader, const TrackPtr& live) {
    ASSIGN_OR_RETURN(const BoardQuery asked, PublicBoard(reader, context_, live));
    if (!IsReplayPublic(reader, context_, asked.track->config)) {
      return std::make_shared<const std::string>();
    }
    const std::string key = absl::StrCat(asked.track->config.hash, "/", asked.view());
    const int64_t changes = reader.BoardChanges();
    if (const KeptBoards::Text found = kept_.Find(key, changes)) return found;
    ASSIGN_OR_RETURN(const Json replay, Replay(reader, asked));
    const auto kept = std::make_shared<const std::string>(replay.is_null() ? "" : replay.dump());
    kept_.Keep(key, changes, kept);
    return kept;
  }

  // The best episode of the leader, or else of the first baseline. Null: there is none to watch.
  absl::StatusOr<Json> Replay(const Transaction& reader, const BoardQuery& asked) {
    const Track& track = *asked.track;
    ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, track, asked.moment()));
    ASSIGN_OR_RETURN(const Leaderboard board, BoardOf(source, track, asked.rules->rules));
    if (board.rows.empty()) return Json();
    const auto leader = std::find_if(board.rows.begin(), board.rows.end(),
                                     [](const LeaderboardRow& row) { return row.ranked.rank > 0; });
    const bool baseline = leader == board.rows.end();
    const StandingRow& first = (baseline ? board.rows.begin() : leader)->source;
    ASSIGN_OR_RETURN(const std::vector<EpisodeRow> rows, reader.episodes.Of(first.evaluation));
    ASSIGN_OR_RETURN(const auto judged, JudgedEpisodes(*track.scoring.track, rows));
    Json summary;
    RETURN_IF_ERROR(AddSummary(track, rows, judged, summary));
    if (summary["highlights"].empty()) return Json();
    const Json& episode = *summary["highlights"].begin();  // "best" or "only"
    return Json{{"phase", TextOrNull(track.config.phase)}, {"track", track.config.id},
                {"profile", track.config.profile}, {"team", first.team},
                {"submission", first.submission}, {"name", first.artefact_name},
                {"baseline", baseline}, {"episode", episode["index"]},
                {"log", episode["log"]["sha256"]}};
  }

  const ApiContext& context_;
  KeptBoards kept_{256, size_t{1} << 20};
};
using Replays = std::shared_ptr<PublicReplays>;

std::string LogPath(const ApiContext& context, const std::string& hash) {
  return absl::StrCat(context.data_dir, "/logs/", LogFileName(hash));
}

// The file as it is stored. Its name is a hash, so no path of a client's making is opened.
absl::Status SendLog(const ApiContext& context, const Request& request, Response& response) {
  const std::string hash = request.matches[1];
  RETURN_IF_ERROR(RequireShownLog(context, hash));
  const absl::Status sent = response.SetFile(LogPath(context, hash), "application/zstd");
  return absl::IsNotFound(sent) ? MissingLog(hash) : sent;
}

// False: it is no longer there.
bool SendFile(const PictureFiles& files, const PictureKey& key, const char* type,
              const Request& request, Response& response) {
  const bool plain = key.kind == PictureKind::kPicture;
  const bool zstd = !plain && TakesCoding(request, "zstd");
  const bool gzip = !plain && !zstd && TakesCoding(request, "gzip");
  // For the few clients that take no compressed answer.
  const bool unpack = !plain && !zstd && !gzip;
  auto found = files.Find(key, plain ? Packing::kPlain : gzip ? Packing::kGzip : Packing::kZstd);
  if (!found.has_value()) return false;
  if (unpack) found->tag.insert(found->tag.size() - 1, ".plain");
  response.SetHeader("Cache-Control",
                     key.kind == PictureKind::kModel ? "no-cache" : "private, no-cache");
  response.SetHeader("Vary", "Accept-Encoding, Authorization");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  if (AnswersWithTag(request, found->tag, response)) return true;
  if (unpack) {
    const absl::StatusOr<std::string> packed = ReadFile(found->path);
    absl::StatusOr<std::string> bytes =
        packed.ok() ? UnpackZstd(*packed, kMostTrajectoryFileBytes) : packed;
    if (bytes.ok()) response.SetContent(*std::move(bytes), type);
    return bytes.ok();
  }
  if (zstd || gzip) response.SetHeader("Content-Encoding", zstd ? "zstd" : "gzip");
  return response.SetFile(found->path, type).ok();
}

// The file, or how far it is.
absl::Status SendPictureFile(const ApiContext& context, const PictureKey& key, const char* type,
                             const Request& request, Response& response) {
  const PictureState state = context.pictures.Ask(key, CallerIsOrganiser() ? "" : CallerKey());
  switch (state.is) {
    case PictureState::Is::kReady:
      if (SendFile(context.pictures.files(), key, type, request, response)) return absl::OkStatus();
      // It was removed this very moment, to make room.
      return Busy("the file was just removed; try again", kAskAgainSeconds);
    case PictureState::Is::kWaiting:
    case PictureState::Is::kPlaying: {
      const bool plays = state.is == PictureState::Is::kPlaying;
      const Json body = {{"state", plays ? "playing" : "waiting"}, {"place", state.place}};
      response.SetHeader("Retry-After", absl::StrCat(kAskAgainSeconds));
      response.SetJson(202, CanonicalJson(body) + "\n");
      return absl::OkStatus();
    }
    case PictureState::Is::kMissing:
      return MissingLog(key.of);
    case PictureState::Is::kFailed:
      return WithErrorCode(absl::FailedPreconditionError(state.why), "no_picture");
    case PictureState::Is::kFull:
      break;
  }
  return Busy("too many trajectories and pictures are waiting; try again later",
              10 * kAskAgainSeconds);
}

// `replays`: nullptr where the log itself must be shown to the caller.
absl::Status SendPictureOfLog(const ApiContext& context, const Replays& replays, PictureKind kind,
                              const char* type, const Request& request, Response& response) {
  const std::string hash = request.matches[1];
  RETURN_IF_ERROR(CheckParameters(request, {}));
  RETURN_IF_ERROR(replays == nullptr ? RequireShownLog(context, hash)
                                     : context.readers.Read([&](const Transaction& reader) {
                                         return replays->Require(reader, hash);
                                       }));
  const PictureKey key = {kind, hash};
  const bool has_log = access(LogPath(context, hash).c_str(), F_OK) == 0;
  if (!has_log && !context.pictures.files().Has(key)) return MissingLog(hash);
  return SendPictureFile(context, key, type, request, response);
}

absl::Status SendModel(const ApiContext& context, const Request& request, Response& response) {
  const std::string track = request.matches[1];
  RETURN_IF_ERROR(CheckParameters(request, {}));
  if (FindTrack(track) == nullptr) {
    return absl::NotFoundError(absl::StrCat("there is no model of track ", track));
  }
  return SendPictureFile(context, {PictureKind::kModel, track}, "model/gltf-binary", request,
                         response);
}

}  // namespace

void AddPictures(Routes& routes, const ApiContext& context) {
  routes.GetFile(R"(/v1/logs/([0-9a-f]{64}))", Action::kReadLog, Bind(context, SendLog));
  const auto replays = std::make_shared<PublicReplays>(context);
  routes.Get("/v1/replays", Action::kReadReplay, [&context, replays](const Request& request) {
    return context.readers.Read<ApiAnswer>([&](const Transaction& reader) -> ApiResult {
      RETURN_IF_ERROR(CheckParameters(request, {}));
      return ApiAnswer{.body = {{"replays", replays->List(reader)}}, .tagged = true};
    });
  });
  // Of one's own logs, and of those that everybody may watch.
  for (const auto& [path, action, of] :
       {std::tuple("/v1/logs/([0-9a-f]{64})", Action::kReadLog, Replays()),
        std::tuple("/v1/replays/([0-9a-f]{64})", Action::kReadReplay, replays)}) {
    routes.GetFile(absl::StrCat(path, "/trajectory"), action,
                   std::bind_front(SendPictureOfLog, std::cref(context), of,
                                   PictureKind::kTrajectory, "application/vnd.myograde.trajectory"));
    routes.GetFile(absl::StrCat(path, "/picture[.]png"), action,
                   std::bind_front(SendPictureOfLog, std::cref(context), of, PictureKind::kPicture,
                                   "image/png"));
  }
  routes.GetFile(R"(/v1/models/([a-z0-9-]{1,64})[.]glb)", Action::kReadTracks,
                 Bind(context, SendModel));
}

}  // namespace myograde::server
