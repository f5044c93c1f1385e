#include "scoring/manipulation/track.h"

#include <array>

#include "protocol/base/status_macros.h"
#include "scoring/config.h"

namespace myograde::scoring {
namespace {

using Place = ManipulationMetric;
using Source = Metric::Source;
using Shown = Metric::Shown;

constexpr std::array<Metric, Place::kCount> kManipulationMetrics = {{
    {.name = "time_s", .title = "time", .unit = "s", .better = Better::kLess,
     .shown = Shown::kAlways, .ranked = true, .spread = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .digits = 6,
     .shown = Shown::kAlways, .ranked = true, .spread = true},
    {.name = "effort_sum", .title = "effort sum", .unit = ""},
    {.name = "reported_time_s", .title = "reported time", .unit = "s"},
    {.name = "peak_force_n", .title = "peak force", .unit = "N", .digits = 1,
     .shown = Shown::kAlways},
    // Not kept with the verdict: rows of earlier versions have none there.
    {.name = "max_touch_n", .title = "peak touch", .unit = "N", .digits = 1,
     .shown = Shown::kWithOfficialFigures, .source = Source::kFacts, .of = "max_touch"},
    {.name = "effort_over_steps", .title = "effort", .unit = "",
     .better = Better::kLess, .digits = 6, .source = Source::kOverSteps, .of = "effort_sum"},
}};
constexpr std::array<std::string_view, 3> kNullMetrics = {"pain", "distance_m", "pain_sum"};
constexpr std::array<std::string_view, 4> kNullMeans = {"pain", "distance_m", "pain_sum",
                                                        "pain_over_steps"};
constexpr std::array<std::string_view, 2> kNullSpreads = {"pain", "distance_m"};

SuccessRule ReadSuccess(ConfigReader& reader) {
  const std::string rule = reader.Choice("success", {"placed", "solved-and-contact", "solved"});
  if (rule == "solved-and-contact") return SuccessRule::kSolvedAndContact;
  return rule == "solved" ? SuccessRule::kSolved : SuccessRule::kPlaced;
}

absl::StatusOr<TrackScoring> ParseManipulation(const nlohmann::json& scoring,
                                               const std::string& where) {
  ConfigReader reader(scoring, where);
  const ManipulationJudging judging = ReadManipulationJudging(reader);
  TrackScoring result;
  result.track = &ScoredManipulation();
  result.judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  result.official_figures = judging.time == TimeSource::kReported;
  result.team = ReadTeam(reader);
  ASSIGN_OR_RETURN(const TieredBoard board,
                   FinishWithTieredBoard(reader, RankedPlace(kManipulationMetrics, Place::kTime),
                                         RankedPlace(kManipulationMetrics, Place::kEffort)));
  std::vector<size_t> columns = {Place::kTime, Place::kEffort};
  if (result.official_figures) columns.push_back(Place::kMaxTouch);
  result.boards[kMainBoard] = {board, std::move(columns)};
  return result;
}

}  // namespace

ManipulationJudging ReadManipulationJudging(ConfigReader& reader) {
  ManipulationJudging judging;
  judging.success = ReadSuccess(reader);
  judging.contact_frames = reader.Integer("contact_frames", 1, 1'000'000);
  judging.force_enforced = reader.Boolean("force_enforced");
  judging.force_limit_n = reader.Number("force_limit_n", {1e-3, 1e9});
  judging.time = ReadTime(reader);
  judging.full_time_s = reader.Number("full_time_s", {1e-3, 1e6});
  judging.phantom = reader.Choice("phantom_reason", {"phantom", "handover"}) == "phantom"
                        ? ManipulationReason::kPhantom
                        : ManipulationReason::kHandover;
  return judging;
}

const ScoredTrack& ScoredManipulation() {
  static const ScoredTrack track = {.name = ManipulationFacts::kTrack,
                                    .metrics = kManipulationMetrics,
                                    .null_metrics = kNullMetrics,
                                    .null_means = kNullMeans,
                                    .null_spreads = kNullSpreads,
                                    .parse = ParseManipulation};
  return track;
}

}  // namespace myograde::scoring
