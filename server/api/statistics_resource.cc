#include "server/api/statistics_resource.h"

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/board_query.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/board_view.h"
#include "server/api/statistics_view.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

absl::StatusOr<std::string> MakeStatisticsText(Reader& reader, const ApiContext& context,
                                               const BoardQuery& asked, KeptStatistics& kept) {
  const Track& track = *asked.track;
  ASSIGN_OR_RETURN(BoardSource source, SourceOf(reader, track, asked.moment()));
  const scoring::BoardRules& rules = asked.rules->rules;
  ASSIGN_OR_RETURN(const Leaderboard board,
                   MakeLeaderboard(source.standings, source.marks, rules, track.scoring.team));
  const scoring::StatisticsConfig config = StatisticsConfigOf(context, track.config.phase);
  ASSIGN_OR_RETURN(const auto statistics, kept.Of(reader, asked, board, config.groups));
  ASSIGN_OR_RETURN(Json json, StatisticsAnswer(reader, track, rules, board, *statistics, config));
  AddBoardAsked(asked, source.withheld, json);
  std::vector<Damage> damaged = source.damaged;
  damaged.insert(damaged.end(), board.damaged.begin(), board.damaged.end());
  damaged.insert(damaged.end(), statistics->damaged.begin(), statistics->damaged.end());
  json["unreadable"] = DamagedToJson(damaged);
  return CanonicalJson(json) + "\n";
}

}  // namespace

StatisticsResource::StatisticsResource(const ApiContext& context, KeptStatistics& statistics)
    : answers_(context, [&context, &statistics](Reader& reader, const BoardQuery& asked) {
        return MakeStatisticsText(reader, context, asked, statistics);
      }) {}

void StatisticsResource::Install(Routes& routes) {
  routes.Get("/v1/leaderboard/statistics", Action::kReadBoard,
             std::bind_front(&StatisticsResource::Get, this));
}

ApiResult StatisticsResource::Get(const Request& request) {
  return answers_.Get(request);
}

}  // namespace myograde::server
