#include "scoring/config.h"

#include "protocol/base/status_macros.h"
#include "scoring/track.h"

namespace myograde::scoring {
namespace {

absl::StatusOr<TieredBoard> ReadTieredBoard(const nlohmann::json& json, const std::string& where,
                                            size_t time, size_t effort) {
  constexpr int64_t kMostEpisodes = 10000;
  ConfigReader reader(json, where);
  TieredBoard board;
  board.line_episodes = reader.Integer("line_episodes", 1, kMostEpisodes);
  board.line_successes = reader.Integer("line_successes", 1, board.line_episodes);
  board.bands = reader.Choice("bands", {"time", "success"}) == "time" ? BandsOver::kTime
                                                                      : BandsOver::kSuccess;
  board.band_factor = reader.Number("band_factor", {1, 10});
  board.ties =
      reader.Choice("ties", {"time", "acceptance"}) == "time" ? Ties::kTime : Ties::kAcceptance;
  board.time = time;
  board.effort = effort;
  RETURN_IF_ERROR(reader.Finish());
  return board;
}

}  // namespace

TimeSource ReadTime(ConfigReader& reader) {
  return reader.Choice("time", {"played", "reported"}) == "played" ? TimeSource::kPlayed
                                                                   : TimeSource::kReported;
}

TeamRule ReadTeam(ConfigReader& reader, const char* key) {
  const std::string team = reader.Choice(key, {"best", "last", "chosen"});
  if (team == "last") return TeamRule::kLast;
  return team == "chosen" ? TeamRule::kChosen : TeamRule::kBest;
}

absl::StatusOr<TieredBoard> FinishWithTieredBoard(ConfigReader& reader, size_t time,
                                                  size_t effort) {
  const std::string where = reader.where() + ": boards";
  ConfigReader boards(reader.Object("boards"), where);
  const auto board = ReadTieredBoard(boards.Object(kMainBoard), where + ": main", time, effort);
  RETURN_IF_ERROR(reader.Finish());
  RETURN_IF_ERROR(boards.Finish());
  return board;
}

}  // namespace myograde::scoring
