#include "server/api/board_source.h"

#include <optional>
#include <set>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/engine/stored.h"
#include "server/grading/tracks.h"

namespace myograde::server {
namespace {

// What the view lacks, or has of other numbers than today's, is made of the episode rows on the
// spot.
absl::Status FillRow(Reader& reader, const std::string& names, StandingRow& row) {
  if (!row.standing.aggregate_json.empty() && row.standing.ranked.names == names) {
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(row.standing, ReadStanding(reader, row.evaluation));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoardSource> SourceOf(Reader& reader, const Track& track,
                                     const BoardMoment& moment) {
  const std::string names = scoring::RankedNames(*track.scoring.track);
  InForce in_force = reader.StandingsInForce(track.config.hash, moment);
  MarksInForce marks = reader.Marks(moment.before_ms);
  BoardSource source{
      {}, std::move(marks.by_submission), std::move(in_force.damaged), in_force.withheld};
  const bool choose = track.scoring.team == scoring::TeamRule::kChosen;
  const std::set<int64_t> chosen =
      choose ? reader.Choices(track.config.hash, moment) : std::set<int64_t>();
  for (StandingRow& row : in_force.rows) {
    row.chosen = chosen.contains(row.submission);
    // Nobody can tell whether it is hidden or disqualified.
    if (const auto mark = marks.damaged.find(row.submission); mark != marks.damaged.end()) {
      source.damaged.push_back(mark->second);
      continue;
    }
    const absl::Status filled = FillRow(reader, names, row);
    if (filled.ok()) {
      source.standings.push_back(std::move(row));
    } else if (const std::optional<Damage> damage = DamageOf(filled)) {
      source.damaged.push_back(*damage);
    } else {
      return filled;
    }
  }
  if (const auto mark = marks.damaged.find(0); mark != marks.damaged.end()) {
    source.damaged.push_back(mark->second);
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

absl::StatusOr<Leaderboard> BoardUnder(Reader& reader, const Track& track, const std::string& board,
                                       const BoardMoment& moment) {
  const auto rules = track.scoring.boards.find(board);
  if (rules == track.scoring.boards.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("track \"", track.config.id, "\" has no board \"", board, "\""));
  }
  ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, track, moment));
  return BoardOf(source, track, rules->second.rules);
}

absl::StatusOr<TrackPtr> TrackAt(Reader& reader, const TrackPtr& live, int64_t before_ms) {
  const TrackConfig& config = live->config;
  if (before_ms == INT64_MAX) return live;
  ASSIGN_OR_RETURN(const std::string hash,
                   reader.ConfigAt({config.phase, config.id, config.profile}, before_ms));
  if (hash.empty() || hash == config.hash) return live;
  return StoredTrack(reader, hash);
}

absl::StatusOr<Standings> RewriteStandings(const ApiContext& context, bool missing_only) {
  ASSIGN_OR_RETURN(Standings made, MakeStandings(context.readers, missing_only));
  // One that ends in between is made of its rows whenever a board needs it.
  RETURN_IF_ERROR(context.engine.Change(
      [rows = made.rows, missing_only](Writer& writer) {
        absl::Status written = missing_only ? absl::OkStatus() : writer.DropStandings();
        for (const auto& [evaluation, standing] : rows) {
          written.Update(writer.SetStanding(evaluation, standing));
        }
        return written;
      },
      context.config.http.upload));
  return made;
}

absl::StatusOr<Leaderboard> BoardAt(Reader& reader, const TrackPtr& live, const std::string& board,
                                    const BoardMoment& moment) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackAt(reader, live, moment.results_before_ms()));
  return BoardUnder(reader, *track, board, moment);
}

}  // namespace myograde::server
