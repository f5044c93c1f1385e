#include "scoring/locomotion/track.h"

#include <array>

#include "protocol/base/status_macros.h"
#include "scoring/config.h"

namespace myograde::scoring {
namespace {

using Step = LocomotionMetric;
using From = Metric::Source;
using Show = Metric::Shown;

constexpr std::array<Metric, Step::kCount> kLocomotionMetrics = {{
    {.name = "distance_m", .title = "distance", .unit = "m", .better = Better::kMore,
     .shown = Show::kAlways, .ranked = true, .spread = true},
    {.name = "time_s", .title = "time", .unit = "s", .better = Better::kLess,
     .shown = Show::kAlways, .ranked = true, .spread = true},
    {.name = "effort", .title = "effort", .unit = "", .better = Better::kLess, .digits = 6,
     .shown = Show::kAlways, .ranked = true, .spread = true},
    {.name = "pain", .title = "pain", .unit = "", .better = Better::kLess, .digits = 6,
     .shown = Show::kAlways, .ranked = true, .spread = true},
    {.name = "effort_sum", .title = "effort sum", .unit = ""},
    {.name = "pain_sum", .title = "pain sum", .unit = ""},
    {.name = "reported_time_s", .title = "reported time", .unit = "s"},
    {.name = "effort_over_steps", .title = "effort", .unit = "",
     .better = Better::kLess, .digits = 6, .source = From::kOverSteps, .of = "effort_sum",
     .ranked = true},
    {.name = "pain_over_steps", .title = "pain", .unit = "",
     .better = Better::kLess, .digits = 6, .source = From::kOverSteps, .of = "pain_sum",
     .ranked = true},
}};
constexpr std::array<std::string_view, 1> kNoForce = {"peak_force_n"};
constexpr std::array<std::string_view, 2> kNoForces = {"peak_force_n", "max_touch_n"};

DistanceBoard ReadDistance(ConfigReader& reader, NumberRange on_course) {
  return {.time_from_m = reader.Number("time_from_m", on_course),
          .band = reader.Number("distance_band", {0, 9}),
          .distance = RankedPlace(kLocomotionMetrics, Step::kDistance),
          .time = RankedPlace(kLocomotionMetrics, Step::kTime)};
}

PhysiologicalBoard ReadPhysiological(ConfigReader& reader, NumberRange on_course) {
  PhysiologicalBoard board;
  board.qualify_m = reader.Number("qualify_m", on_course);
  const bool steps = reader.Choice("means", {"steps", "episodes"}) == "steps";
  board.means = steps ? MeansOver::kSteps : MeansOver::kEpisodes;
  board.distance = RankedPlace(kLocomotionMetrics, Step::kDistance);
  board.pain = RankedPlace(kLocomotionMetrics, steps ? Step::kPainOverSteps : Step::kPain);
  board.effort = RankedPlace(kLocomotionMetrics, steps ? Step::kEffortOverSteps : Step::kEffort);
  return board;
}

absl::StatusOr<TrackScoring> ParseLocomotion(const nlohmann::json& scoring,
                                             const std::string& where) {
  ConfigReader reader(scoring, where);
  const LocomotionJudging judging = ReadLocomotionJudging(reader);
  TrackScoring result;
  result.track = &ScoredLocomotion();
  result.judge = [judging](const EpisodeFacts& facts) { return Judge(facts, judging); };
  result.official_figures = judging.time == TimeSource::kReported;
  result.team = ReadTeam(reader);

  const std::string boards_where = where + ": boards";
  ConfigReader boards(reader.Object("boards"), boards_where);
  ConfigReader main(boards.Object(kMainBoard), boards_where + ": main");
  ConfigReader physiological(boards.Object("physiological"), boards_where + ": physiological");
  const NumberRange on_course{0, judging.course_m};
  const DistanceBoard distance = ReadDistance(main, on_course);
  const PhysiologicalBoard body = ReadPhysiological(physiological, on_course);
  for (ConfigReader* part : {&reader, &boards, &main, &physiological}) {
    RETURN_IF_ERROR(part->Finish());
  }
  const bool steps = body.means == MeansOver::kSteps;
  result.boards[kMainBoard] = {distance,
                               {Step::kDistance, Step::kTime, Step::kEffort, Step::kPain}};
  result.boards["physiological"] = {body,
                                    {Step::kDistance, Step::kTime,
                                     steps ? Step::kEffortOverSteps : Step::kEffort,
                                     steps ? Step::kPainOverSteps : Step::kPain}};
  return result;
}

}  // namespace

LocomotionJudging ReadLocomotionJudging(ConfigReader& reader) {
  LocomotionJudging judging;
  judging.time = ReadTime(reader);
  judging.full_time_s = reader.Number("full_time_s", {1e-3, 1e6});
  judging.course_m = reader.Number("course_m", {1e-3, 1e6});
  return judging;
}

const ScoredTrack& ScoredLocomotion() {
  static const ScoredTrack track = {.name = LocomotionFacts::kTrack,
                                    .metrics = kLocomotionMetrics,
                                    .null_metrics = kNoForce,
                                    .null_means = kNoForces,
                                    .null_spreads = {},
                                    .parse = ParseLocomotion};
  return track;
}

}  // namespace myograde::scoring
