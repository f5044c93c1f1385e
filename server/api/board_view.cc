#include "server/api/board_view.h"

#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/views.h"
#include "server/grading/leaderboard.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The numbers that the board shows beside the successes.
Json ColumnsToJson(const scoring::ScoredTrack& track, const scoring::BoardSpec& board) {
  Json columns = Json::array();
  for (const size_t place : board.columns) columns.push_back(MetricToJson(track.metrics[place]));
  return columns;
}

// Which build each row is of, and which one the board itself is of.
void AddBuilds(Reader& reader, const Leaderboard& board, Json& json) {
  std::vector<int64_t> evaluations;
  for (const LeaderboardRow& row : board.rows) evaluations.push_back(row.source.evaluation);
  const BoardBuilds builds = CountBuilds(evaluations, reader.GradersOf(evaluations));
  for (size_t i = 0; i < builds.of_rows.size(); ++i) {
    json["rows"][i]["build"] = builds.of_rows[i];
    json["rows"][i]["other_build"] = builds.of_rows[i] != builds.own();
  }
  json["builds"] = Json::array();
  for (const BoardBuilds::Count& count : builds.counts) {
    json["builds"].push_back({{"build", count.build}, {"rows", count.rows}});
  }
}

// What ranked submissions stand under beside the board's config.
void AddOtherConfigs(Reader& reader, const BoardQuery& asked, Json& json) {
  const std::string& config = asked.track->config.hash;
  const BoardMoment moment = asked.moment();
  json["other_config"] = reader.RankedElsewhere(asked.name(), config, moment);
  json["other_configs"] = Json::array();
  for (const OtherConfig& other : reader.OtherConfigs(asked.name(), config, moment)) {
    json["other_configs"].push_back({{"config", other.config},
                                     {"submissions", other.submissions},
                                     {"teams", other.teams},
                                     {"from", TimeToJson(other.first_at)},
                                     {"to", TimeToJson(other.last_at)},
                                     {"in_force", other.config == asked.config_in_force}});
  }
}

// Gives each row the rank of its group.
absl::Status PublishGroups(Reader& reader, const BoardQuery& asked,
                           const scoring::GroupRules& group_rules, const Leaderboard& board,
                           KeptStatistics& kept, std::vector<Damage>& damaged, Json& json) {
  ASSIGN_OR_RETURN(const auto statistics, kept.Of(reader, asked, board, group_rules));
  damaged.insert(damaged.end(), statistics->damaged.begin(), statistics->damaged.end());
  const std::vector<int64_t> ranks = PublishedRanks(board, *statistics);
  for (size_t i = 0; i < ranks.size(); ++i) {
    if (ranks[i] != 0) json["rows"][i]["rank"] = ranks[i];
  }
  return absl::OkStatus();
}

Json BoardToJson(const Leaderboard& board) {
  Json rows = Json::array();
  for (const LeaderboardRow& row : board.rows) rows.push_back(RowToJson(row));
  Json disqualified = Json::array();
  for (const DisqualifiedRow& row : board.disqualified) {
    disqualified.push_back({{"team", row.source.team},
                            {"submission", row.source.submission},
                            {"evaluation", row.source.evaluation},
                            {"rejudge", IdOrNull(row.source.rejudge)},
                            {"name", row.source.artefact_name},
                            {"reason", row.mark.why},
                            {"at", TimeToJson(row.mark.at)},
                            {"aggregate", row.aggregate}});
  }
  return {{"rows", std::move(rows)}, {"disqualified", std::move(disqualified)}};
}

}  // namespace

Json RowToJson(const LeaderboardRow& row) {
  const bool baseline = row.ranked.rank == 0;
  return {{"rank", baseline ? Json() : Json(row.ranked.rank)},
          {"rank_by_rules", baseline ? Json() : Json(row.ranked.rank)},
          {"baseline", baseline},
          {"team", row.source.team},
          {"submission", row.source.submission},
          {"evaluation", row.source.evaluation},
          {"rejudge", IdOrNull(row.source.rejudge)},
          {"name", row.source.artefact_name},
          {"qualified", row.qualified},
          {"aggregate", row.aggregate}};
}

void AddBoardAsked(const BoardQuery& asked, bool withheld, Json& json) {
  const TrackConfig& config = asked.track->config;
  json["track"] = config.id;
  json["track_kind"] = config.kind->name;
  json["profile"] = config.profile;
  json["phase"] = TextOrNull(config.phase);
  json["board"] = asked.board;
  json["config"] = config.hash;
  json["config_in_force"] = asked.config_in_force;
  json["at"] = TimeToJson(asked.at_ms);
  json["episodes"] = config.seeds.size();
  const bool froze = asked.frozen || withheld;
  json["frozen_at"] = froze ? TimeToJson(absl::ToUnixMillis(asked.freezes)) : Json();
  json["complete"] = asked.whole || !froze;
}

absl::StatusOr<Json> BoardView(Reader& reader, const BoardQuery& asked,
                               const scoring::StatisticsConfig& statistics,
                               KeptStatistics& kept) {
  const TrackConfig& config = asked.track->config;
  ASSIGN_OR_RETURN(BoardSource source, SourceOf(reader, *asked.track, asked.moment()));
  ASSIGN_OR_RETURN(Leaderboard board,
                   MakeLeaderboard(source.standings, source.marks, asked.rules->rules,
                                   asked.track->scoring.team));
  Json json = BoardToJson(board);
  if (statistics.ranks == scoring::StatisticsConfig::Ranks::kGroups) {
    RETURN_IF_ERROR(
        PublishGroups(reader, asked, statistics.groups, board, kept, source.damaged, json));
  }
  json["ranks"] = scoring::StatisticsToJson(statistics)["ranks"];
  AddBuilds(reader, board, json);
  AddOtherConfigs(reader, asked, json);
  source.damaged.insert(source.damaged.end(), board.damaged.begin(), board.damaged.end());
  json["unreadable"] = DamagedToJson(source.damaged);
  AddBoardAsked(asked, source.withheld, json);
  json["rules"] = config.scoring["boards"][asked.board];
  json["official_figures"] = asked.track->scoring.official_figures;
  json["columns"] = ColumnsToJson(*asked.track->scoring.track, *asked.rules);
  json["order"] = scoring::DescribeOrder(asked.rules->rules);
  return json;
}

}  // namespace myograde::server
