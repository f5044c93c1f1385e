#include "server/api/board_source.h"

#include <map>
#include <optional>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "scoring/aggregate_json.h"
#include "server/api/caller.h"
#include "server/api/requests.h"

namespace myograde::server {
namespace {

constexpr size_t kLeastDigits = 8;  // of a config's hash
constexpr size_t kHashDigits = 64;

// A phase that no file describes any more is found by its submissions.
absl::StatusOr<TrackPtr> TrackOfPhase(const Transaction& reader, const ApiContext& context,
                                      const std::string& name) {
  const absl::StatusOr<PhasePtr> phase = context.phases.Find(name);
  if (phase.ok()) return (*phase)->track;
  const std::string config = reader.Board().ConfigOfPhase(name);
  if (config.empty()) return phase.status();
  return StoredTrack(reader, config);
}

// Whether the request says nothing else than the config of a board.
absl::Status CheckNamed(const Request& request, const TrackConfig& config) {
  const std::string name = request.Param("track");
  const std::string profile = request.Param("profile");
  const std::string phase = request.Param("phase");
  const bool fits = (name.empty() || name == config.id) &&
                    (profile.empty() || profile == config.profile) &&
                    (!request.HasParam("phase") || phase == config.phase);
  if (fits) return absl::OkStatus();
  const std::string what = request.HasParam("config") ? absl::StrCat("config ", config.hash)
                                                      : absl::StrCat("phase \"", phase, "\"");
  const std::string of_phase = config.phase.empty() || !request.HasParam("config")
                                   ? ""
                                   : absl::StrCat(", and of the phase \"", config.phase, "\"");
  return absl::InvalidArgumentError(absl::StrCat(
      what, " is of track \"", config.id, "\" in the profile \"", config.profile, "\"", of_phase));
}

// The board's own config, as it is now.
absl::StatusOr<TrackPtr> NamedTrack(const Request& request, const Transaction& reader,
                                    const ApiContext& context) {
  if (!request.HasParam("phase")) {
    if (request.HasParam("track")) {
      return context.tracks.Find(request.Param("track"), request.Param("profile"));
    }
    return absl::InvalidArgumentError(
        "\"track\" is missing: a board belongs to one track, or to one \"phase\"");
  }
  ASSIGN_OR_RETURN(TrackPtr track, TrackOfPhase(reader, context, request.Param("phase")));
  RETURN_IF_ERROR(CheckNamed(request, track->config));
  return track;
}

// The track whose config's hash begins with `digits`, of those that a board has or had.
absl::StatusOr<TrackPtr> FindConfig(const std::string& digits, const Transaction& reader,
                                    const ApiContext& context) {
  const bool hexadecimal = digits.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!hexadecimal || digits.size() < kLeastDigits || digits.size() > kHashDigits) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"config\" must be the hash of a config, or its first ", kLeastDigits,
                     " or more hexadecimal digits"));
  }
  std::map<std::string, TrackPtr> found;
  for (const std::string& hash : reader.Board().ConfigsLike(digits, CallerIsOrganiser()))
    found[hash];
  // Nothing need have been accepted under what is played now.
  const auto add = [&](const TrackPtr& track) {
    if (track->config.hash.starts_with(digits)) found[track->config.hash] = track;
  };
  for (const auto& [name, entry] : context.tracks.entries()) {
    for (const auto& [profile, track] : entry.profiles) add(track);
  }
  for (const PhasePtr& phase : context.phases.entries()) add(phase->track);
  if (found.size() == 1) {
    const auto& [hash, track] = *found.begin();
    if (track != nullptr) return track;
    return StoredTrack(reader, hash);
  }
  if (found.empty()) {
    return absl::NotFoundError(absl::StrCat("no board has or had a config ", digits,
                                            "; \"other_configs\" of a board lists its configs"));
  }
  const std::string hashes = absl::StrJoin(
      found, ", ", [](std::string* out, const auto& entry) { out->append(entry.first); });
  return absl::InvalidArgumentError(
      absl::StrCat("several configs begin with ", digits, ": ", hashes, "; give more digits"));
}

// The track that a request names by its config, as `asked`, and what its board has now or had last.
absl::StatusOr<TrackPtr> FindTracks(const Request& request, const Transaction& reader,
                                    const ApiContext& context, TrackPtr& asked) {
  ASSIGN_OR_RETURN(asked, FindConfig(request.Param("config"), reader, context));
  const TrackConfig& config = asked->config;
  RETURN_IF_ERROR(CheckNamed(request, config));
  absl::StatusOr<TrackPtr> live = config.phase.empty()
                                      ? context.tracks.Find(config.id, config.profile)
                                      : TrackOfPhase(reader, context, config.phase);
  // A track that is not on offer any more has no other config either.
  if (absl::IsNotFound(live.status())) return asked;
  return live;
}

// The moment that a request asks for, in milliseconds; 0: now.
absl::StatusOr<int64_t> ReadMoment(const Request& request, absl::Time now) {
  if (!request.HasParam("at")) return int64_t{0};
  absl::Time time;
  const std::string text = request.Param("at");
  if (!absl::ParseTime(absl::RFC3339_full, text, &time, nullptr) ||
      time < absl::FromUnixMillis(1) || time == absl::InfiniteFuture()) {
    return absl::InvalidArgumentError(
        "\"at\" must be a time like 2026-12-01T00:00:00Z, in 1970 or later");
  }
  if (time > now) {
    return absl::InvalidArgumentError(absl::StrCat("\"at\" is ", UtcText(time),
                                                   ", which is in the future; leave it out for "
                                                   "the present board"));
  }
  return absl::ToUnixMillis(time);
}

// From a phase's freeze on, only organisers see what ends later.
void AddFreeze(const Transaction& reader, const ApiContext& context, absl::Time now,
               BoardQuery& asked) {
  const PhaseConfig* phase = context.phases.ConfigOf(asked.track->config.phase);
  if (phase == nullptr) return;
  const PhaseStatus status = StatusOfPhase(*phase, reader.Board(), now);
  const bool ever = phase->freezes != absl::InfiniteFuture();
  if (!ever || status.published || status.revealed) return;
  asked.freezes = phase->freezes;
  const absl::Time shown = asked.at_ms == 0 ? now : absl::FromUnixMillis(asked.at_ms);
  asked.frozen = status.frozen && shown >= phase->freezes;
  asked.whole = CallerIsOrganiser();
}

// The configs of a query of which all else is known. From a freeze on, a board keeps the config
// that it had then: results under another one would all be hidden.
absl::Status AddConfigs(const Request& request, const Transaction& reader, const TrackPtr& live,
                        BoardQuery& asked) {
  const BoardMoment moment = asked.moment();
  ASSIGN_OR_RETURN(const TrackPtr then, TrackAt(reader, live, moment.before_ms));
  asked.config_in_force = then->config.hash;
  if (request.HasParam("config")) return absl::OkStatus();
  asked.track = then;
  if (asked.frozen && !asked.whole) {
    ASSIGN_OR_RETURN(asked.track, TrackAt(reader, live, moment.results_before_ms()));
  }
  return absl::OkStatus();
}

// Completes a row, which has what the view says. What the view lacks, or has of other numbers than
// today's, is made of the episode rows on the spot.
absl::Status FillRow(const Transaction& reader, const Track& track, StandingRow& row) {
  if (row.artefact_name.empty()) {
    ASSIGN_OR_RETURN(const SubmissionRow submission, reader.submissions.Find(row.submission));
    row.artefact_name = submission.artefact_name;
  }
  if (HasRankedNumbers(*track.scoring.track, row.aggregate)) return absl::OkStatus();
  ASSIGN_OR_RETURN(row.aggregate, ReadStanding(reader, row.evaluation));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoardQuery> ParseBoardQuery(const Request& request, const Transaction& reader,
                                           const ApiContext& context,
                                           const std::vector<std::string>& others) {
  std::vector<std::string> known = {"track", "profile", "phase", "board", "config", "at"};
  known.insert(known.end(), others.begin(), others.end());
  RETURN_IF_ERROR(CheckParameters(request, known));
  const absl::Time now = context.clock.Now();
  BoardQuery asked;
  ASSIGN_OR_RETURN(asked.at_ms, ReadMoment(request, now));
  asked.board = request.HasParam("board") ? request.Param("board") : scoring::kMainBoard;
  ASSIGN_OR_RETURN(const TrackPtr live, request.HasParam("config")
                                            ? FindTracks(request, reader, context, asked.track)
                                            : NamedTrack(request, reader, context));
  if (asked.track == nullptr) asked.track = live;
  AddFreeze(reader, context, now, asked);
  RETURN_IF_ERROR(AddConfigs(request, reader, live, asked));
  ASSIGN_OR_RETURN(asked.rules, FindBoard(*asked.track, asked.board));
  return asked;
}

absl::StatusOr<TrackPtr> TrackInForce(const Transaction& reader, const ApiContext& context,
                                      const BoardName& board) {
  if (board.phase.empty()) return context.tracks.Find(board.track, board.profile);
  if (context.phases.ConfigOf(board.phase) == nullptr) {
    return TrackOfPhase(reader, context, board.phase);
  }
  ASSIGN_OR_RETURN(const PhasePtr phase, context.phases.Find(board.phase));
  return phase->track;
}

absl::StatusOr<BoardQuery> PublicBoard(const Transaction& reader, const ApiContext& context,
                                       const TrackPtr& live) {
  BoardQuery asked{.track = live, .board = scoring::kMainBoard};
  AddFreeze(reader, context, context.clock.Now(), asked);
  asked.whole = asked.freezes == absl::InfiniteFuture();
  RETURN_IF_ERROR(AddConfigs(Request(), reader, live, asked));
  asked.rules = &asked.track->scoring.boards.at(asked.board);
  return asked;
}

absl::StatusOr<BoardSource> SourceOf(const Transaction& reader, const Track& track,
                                     const BoardMoment& moment) {
  const BoardState& board = reader.Board();
  const std::string& config = track.config.hash;
  BoardSource source{.standings = {},
                     .marks = board.MarksAt(moment.before_ms),
                     .damaged = {},
                     .withheld = board.Withholds(config, moment)};
  for (const auto& [act, what] : board.damaged()) {
    source.damaged.push_back({"journal", absl::StrCat(act), what});
  }
  std::vector<StandingRow> rows = board.Candidates(config, moment);
  reader.episodes.ReadStandings(rows);
  for (StandingRow& row : rows) {
    if (const absl::Status filled = FillRow(reader, track, row); filled.ok()) {
      source.standings.push_back(std::move(row));
    } else if (const std::optional<Damage> damage = ExtractDamage(filled)) {
      source.damaged.push_back(*damage);
    } else {
      return filled;
    }
  }
  return source;
}

absl::StatusOr<Leaderboard> BoardOf(const BoardSource& source, const Track& track,
                                    const scoring::BoardRules& rules) {
  return MakeLeaderboard(source.standings, source.marks, rules, track.scoring);
}

absl::StatusOr<const scoring::BoardSpec*> FindBoard(const Track& track, const std::string& board) {
  const auto found = track.scoring.boards.find(board);
  if (found != track.scoring.boards.end()) return &found->second;
  return absl::InvalidArgumentError(
      absl::StrCat("track \"", track.config.id, "\" has no board \"", board, "\""));
}

absl::StatusOr<Leaderboard> BoardUnder(const Transaction& reader, const Track& track,
                                       const std::string& board, const BoardMoment& moment) {
  ASSIGN_OR_RETURN(const scoring::BoardSpec* spec, FindBoard(track, board));
  ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, track, moment));
  return BoardOf(source, track, spec->rules);
}

absl::StatusOr<TrackPtr> TrackAt(const Transaction& reader, const TrackPtr& live,
                                 int64_t before_ms) {
  const TrackConfig& config = live->config;
  if (before_ms == INT64_MAX) return live;
  const std::string hash =
      reader.Board().ConfigAt({config.phase, config.id, config.profile}, before_ms);
  if (hash.empty() || hash == config.hash) return live;
  return StoredTrack(reader, hash);
}

absl::StatusOr<Standings> RewriteStandings(const ApiContext& context, bool missing_only) {
  ASSIGN_OR_RETURN(Standings made, MakeStandings(context.readers, missing_only));
  // One that ends in between is made of its rows whenever a board needs it.
  RETURN_IF_ERROR(context.engine.Change(
      [rows = made.rows, missing_only](Transaction& writer) {
        absl::Status written = missing_only ? absl::OkStatus() : writer.episodes.DropStandings();
        for (const auto& [evaluation, standing] : rows) {
          written.Update(writer.episodes.SetStanding(evaluation, standing));
        }
        return written;
      },
      context.config.http.upload));
  return made;
}

}  // namespace myograde::server
