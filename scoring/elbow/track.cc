#include "scoring/elbow/track.h"

#include <array>

#include "protocol/base/status_macros.h"
#include "scoring/config.h"
#include "scoring/elbow/judge.h"

namespace myograde::scoring {
namespace elbow {
namespace {

using Place = ElbowMetric;
using Shown = Metric::Shown;

constexpr std::array<Metric, Place::kCount> kMetrics = {{
    {.name = "time_s", .title = "time", .unit = "s", .better = Better::kLess,
     .shown = Shown::kAlways, .ranked = true, .spread = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .digits = 6,
     .shown = Shown::kAlways, .ranked = true, .spread = true},
    {.name = "effort_sum", .title = "effort sum", .unit = ""},
    {.name = "reported_time_s", .title = "reported time", .unit = "s"},
    {.name = "final_error_rad", .title = "final error", .unit = "rad",
     .shown = Shown::kAlways, .spread = true},
}};

ElbowJudging ReadJudging(ConfigReader& reader) {
  ElbowJudging judging;
  judging.success = reader.Choice("success", {"held", "solved"}) == "held" ? ElbowSuccess::kHeld
                                                                           : ElbowSuccess::kSolved;
  judging.solved_steps = reader.Integer("solved_steps", 1, 1'000'000);
  judging.time = ReadTime(reader);
  judging.full_time_s = reader.Number("full_time_s", {1e-3, 1e6});
  return judging;
}

absl::StatusOr<TrackScoring> Parse(const nlohmann::json& scoring, const std::string& where) {
  ConfigReader reader(scoring, where);
  const ElbowJudging judging = ReadJudging(reader);
  TrackScoring result;
  result.track = &ScoredElbow();
  result.judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  result.official_figures = judging.time == TimeSource::kReported;
  result.team = ReadTeam(reader);
  ASSIGN_OR_RETURN(const TieredBoard board,
                   FinishWithTieredBoard(reader, RankedPlace(kMetrics, Place::kTime),
                                         RankedPlace(kMetrics, Place::kEffort)));
  result.boards[kMainBoard] = {board, {Place::kTime, Place::kEffort}};
  return result;
}

}  // namespace
}  // namespace elbow

const ScoredTrack& ScoredElbow() {
  static const ScoredTrack track = {.name = ElbowFacts::kTrack,
                                    .metrics = elbow::kMetrics,
                                    .null_metrics = {},
                                    .null_means = {},
                                    .null_spreads = {},
                                    .parse = elbow::Parse};
  return track;
}

}  // namespace myograde::scoring
