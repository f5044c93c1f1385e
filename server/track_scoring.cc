#include "server/track_scoring.h"

#include <absl/strings/str_cat.h>

#include "protocol/config_reader.h"

namespace myograde::server {
namespace {

using scoring::BandsOver;
using scoring::SuccessRule;
using scoring::TeamRule;
using scoring::TimeSource;

TimeSource ReadTime(ConfigReader& reader) {
  return reader.Choice("time", {"played", "reported"}) == "played" ? TimeSource::kPlayed
                                                                   : TimeSource::kReported;
}

TeamRule ReadTeam(ConfigReader& reader) {
  const std::string team = reader.Choice("team", {"best", "last", "chosen"});
  if (team == "last") return TeamRule::kLast;
  return team == "chosen" ? TeamRule::kChosen : TeamRule::kBest;
}

SuccessRule ReadSuccess(ConfigReader& reader) {
  const std::string rule = reader.Choice("success", {"placed", "solved-and-contact", "solved"});
  if (rule == "solved-and-contact") return SuccessRule::kSolvedAndContact;
  return rule == "solved" ? SuccessRule::kSolved : SuccessRule::kPlaced;
}

FailureReason ReadPhantomReason(ConfigReader& reader) {
  return reader.Choice("phantom_reason", {"phantom", "handover"}) == "phantom"
             ? FailureReason::kPhantom
             : FailureReason::kHandover;
}

absl::StatusOr<scoring::BoardRules> ReadTieredBoard(const nlohmann::json& json,
                                                    const std::string& where) {
  ConfigReader reader(json, where);
  scoring::TieredBoard board;
  board.line_episodes = reader.Integer("line_episodes", 1, kMaxEpisodes);
  board.line_successes = reader.Integer("line_successes", 1, board.line_episodes);
  board.bands = reader.Choice("bands", {"time", "success"}) == "time" ? BandsOver::kTime
                                                                      : BandsOver::kSuccess;
  board.band_factor = reader.Number("band_factor", {1, 10});
  board.ties = reader.Choice("ties", {"time", "acceptance"}) == "time" ? scoring::Ties::kTime
                                                                       : scoring::Ties::kAcceptance;
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  return board;
}

absl::Status ReadManipulation(const TrackConfig& config, const std::string& where,
                              TrackScoring& result) {
  ConfigReader reader(config.scoring, where);
  scoring::ManipulationJudging judging;
  judging.success = ReadSuccess(reader);
  judging.contact_frames = reader.Integer("contact_frames", 1, 1'000'000);
  judging.force_enforced = reader.Boolean("force_enforced");
  judging.force_limit_n = reader.Number("force_limit_n", {1e-3, 1e9});
  judging.time = ReadTime(reader);
  judging.full_time_s = reader.Number("full_time_s", {1e-3, 1e6});
  judging.phantom = ReadPhantomReason(reader);
  result.judging = judging;
  result.team = ReadTeam(reader);

  const std::string boards_where = where + ": boards";
  ConfigReader boards(reader.Object("boards"), boards_where);
  const auto board = ReadTieredBoard(boards.Object(kMainBoard), boards_where + ": main");
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  if (absl::Status status = boards.Finish(); !status.ok()) return status;
  if (!board.ok()) return board.status();
  result.boards[kMainBoard] = *board;
  return absl::OkStatus();
}

absl::Status ReadLocomotion(const TrackConfig& config, const std::string& where,
                            TrackScoring& result) {
  ConfigReader reader(config.scoring, where);
  scoring::LocomotionJudging judging;
  judging.time = ReadTime(reader);
  judging.full_time_s = reader.Number("full_time_s", {1e-3, 1e6});
  judging.course_m = reader.Number("course_m", {1e-3, 1e6});
  result.judging = judging;
  result.team = ReadTeam(reader);

  const std::string boards_where = where + ": boards";
  ConfigReader boards(reader.Object("boards"), boards_where);
  ConfigReader main(boards.Object(kMainBoard), boards_where + ": main");
  ConfigReader physiological(boards.Object("physiological"), boards_where + ": physiological");
  const NumberRange on_course{0, judging.course_m};
  const scoring::DistanceBoard distance{.time_from_m = main.Number("time_from_m", on_course),
                                        .band = main.Number("distance_band", {0, 9})};
  const scoring::PhysiologicalBoard body{
      .qualify_m = physiological.Number("qualify_m", on_course),
      .means = physiological.Choice("means", {"steps", "episodes"}) == "steps"
                   ? scoring::MeansOver::kSteps
                   : scoring::MeansOver::kEpisodes};
  for (ConfigReader* part : {&reader, &boards, &main, &physiological}) {
    if (absl::Status status = part->Finish(); !status.ok()) return status;
  }
  result.boards[kMainBoard] = distance;
  result.boards["physiological"] = body;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<TrackScoring> ParseTrackScoring(const TrackConfig& config) {
  const std::string where =
      absl::StrCat("track config ", config.id, " (profile ", config.profile, "): scoring");
  TrackScoring result;
  const absl::Status status = config.kind == TrackKind::kManipulation
                                  ? ReadManipulation(config, where, result)
                                  : ReadLocomotion(config, where, result);
  if (!status.ok()) return status;
  return result;
}

bool HasOfficialFigures(const TrackConfig& config) {
  return config.scoring.value("time", nlohmann::json()) == "reported";
}

scoring::Judgement JudgeEpisode(const TrackScoring& track, const EpisodeFacts& facts) {
  return std::visit([&](const auto& rules) { return scoring::Judge(facts, rules); },
                    track.judging);
}

}  // namespace myograde::server
