#include "server/api/board_source.h"

#include <optional>
#include <set>
#include <string>
#include <utility>

#include "server/engine/standings.h"

namespace myograde::server {
namespace {

// What the view lacks, or has of other numbers than today's, is made of the episode rows on the
// spot.
absl::Status FillRow(Reader& reader, const std::string& names, StandingRow& row) {
  if (!row.standing.aggregate_json.empty() && row.standing.ranked.names == names) {
    return absl::OkStatus();
  }
  absl::StatusOr<Standing> standing = ReadStanding(reader, row.evaluation);
  if (!standing.ok()) return standing.status();
  row.standing = *std::move(standing);
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoardSource> SourceOf(Reader& reader, const Track& track, int64_t before_ms) {
  const std::string names = scoring::RankedNames(*track.scoring.track);
  Listed<StandingRow> listed = reader.Standings(track.config.hash);
  MarksInForce marks = reader.Marks();
  BoardSource source{{}, std::move(marks.by_submission), std::move(listed.damaged)};
  const bool choose = track.scoring.team == scoring::TeamRule::kChosen;
  const std::set<int64_t> chosen =
      choose ? reader.Choices(track.config.hash, before_ms) : std::set<int64_t>();
  for (StandingRow& row : listed.rows) {
    if (row.finished_at >= before_ms) {
      source.withheld = true;
      continue;
    }
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

}  // namespace myograde::server
