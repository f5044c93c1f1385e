#include "server/api/board_source.h"

#include <map>
#include <optional>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// What the view lacks, or has of other numbers than today's, is made of the episode rows on the
// spot.
absl::Status FillRow(const Transaction& reader, const std::string& names, StandingRow& row) {
  if (!row.standing.aggregate_json.empty() && row.standing.ranked.names == names) {
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(row.standing, ReadStanding(reader, row.evaluation));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoardSource> SourceOf(const Transaction& reader, const Track& track,
                                     const BoardMoment& moment) {
  const BoardState& board = reader.Board();
  const std::string& config = track.config.hash;
  const std::string names = scoring::RankedNames(*track.scoring.track);
  BoardSource source{.standings = {},
                     .marks = board.MarksAt(moment.before_ms),
                     .damaged = {},
                     .withheld = board.Withholds(config, moment)};
  for (const auto& [act, what] : board.damaged()) {
    source.damaged.push_back({"journal", absl::StrCat(act), what});
  }
  const bool choose = track.scoring.team == scoring::TeamRule::kChosen;
  const std::set<int64_t> chosen = choose ? board.Chosen(config, moment) : std::set<int64_t>();
  const std::map<int64_t, const BoardResult*> in_force = board.InForce(config, moment);
  std::vector<int64_t> evaluations;
  for (const auto& [submission, result] : in_force) evaluations.push_back(result->evaluation);
  std::map<int64_t, Standing> standings = reader.episodes.Standings(evaluations);
  for (const auto& [submission, result] : in_force) {
    const TeamState* team = board.TeamOf(submission);
    if (result->failed || team->banned) continue;
    const absl::StatusOr<SubmissionRow> stored = reader.submissions.Find(submission);
    StandingRow row{.submission = submission,
                    .evaluation = result->evaluation,
                    .team = team->name,
                    .artefact_name = stored.ok() ? stored->artefact_name : "",
                    .standing = std::move(standings[result->evaluation]),
                    .finished_at = result->at,
                    .chosen = chosen.contains(submission),
                    .rejudge = result->rejudge};
    absl::Status filled = stored.status();
    if (filled.ok()) filled = FillRow(reader, names, row);
    if (filled.ok()) {
      source.standings.push_back(std::move(row));
    } else if (const std::optional<Damage> damage = DamageOf(filled)) {
      source.damaged.push_back(*damage);
    } else {
      return filled;
    }
  }
  return source;
}

absl::StatusOr<Leaderboard> BoardOf(const BoardSource& source, const Track& track,
                                    const scoring::BoardRules& rules) {
  ASSIGN_OR_RETURN(Leaderboard made,
                   MakeLeaderboard(source.standings, source.marks, rules, track.scoring.team));
  made.damaged.insert(made.damaged.begin(), source.damaged.begin(), source.damaged.end());
  return made;
}

absl::StatusOr<Leaderboard> BoardUnder(const Transaction& reader, const Track& track,
                                       const std::string& board, const BoardMoment& moment) {
  const auto rules = track.scoring.boards.find(board);
  if (rules == track.scoring.boards.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("track \"", track.config.id, "\" has no board \"", board, "\""));
  }
  ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, track, moment));
  return BoardOf(source, track, rules->second.rules);
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
