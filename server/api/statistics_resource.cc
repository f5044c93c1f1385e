#include "server/api/statistics_resource.h"

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/config_reader.h"
#include "server/api/board_query.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/requests.h"
#include "server/api/statistics_view.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Which board it is of.
void AddBoard(const BoardQuery& asked, bool withheld, Json& json) {
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

absl::StatusOr<std::string> MakeStatisticsText(Reader& reader, const ApiContext& context,
                                               const BoardQuery& asked) {
  const Track& track = *asked.track;
  absl::StatusOr<BoardSource> source = SourceOf(reader, track, asked.moment());
  if (!source.ok()) return source.status();
  const scoring::BoardRules& rules = asked.rules->rules;
  const absl::StatusOr<Leaderboard> board =
      MakeLeaderboard(source->standings, source->marks, rules, track.scoring.team);
  if (!board.ok()) return board.status();
  const scoring::StatisticsConfig config = StatisticsConfigOf(context, track.config.phase);
  const absl::StatusOr<BoardStatistics> statistics =
      StatisticsOf(reader, track, rules, *board, config.groups,
                   asked.moment().results_before_ms());
  if (!statistics.ok()) return statistics.status();
  absl::StatusOr<Json> json = StatisticsAnswer(reader, track, rules, *board, *statistics, config);
  if (!json.ok()) return json.status();
  AddBoard(asked, source->withheld, *json);
  std::vector<Damage> damaged = source->damaged;
  damaged.insert(damaged.end(), board->damaged.begin(), board->damaged.end());
  damaged.insert(damaged.end(), statistics->damaged.begin(), statistics->damaged.end());
  (*json)["unreadable"] = DamagedToJson(damaged);
  return CanonicalJson(*json) + "\n";
}

}  // namespace

void StatisticsResource::Install(Routes& routes) {
  routes.Get("/v1/leaderboard/statistics", Action::kReadBoard,
             std::bind_front(&StatisticsResource::Get, this));
}

ApiResult StatisticsResource::Get(const httplib::Request& request) {
  absl::Status status = CheckParameters(request, BoardParametersAnd({}));
  if (!status.ok()) return ErrorOf(status);
  ApiAnswer answer{.tagged = true};
  status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    const absl::StatusOr<BoardQuery> asked = ParseBoardQuery(request, reader, context_);
    if (!asked.ok()) return asked.status();
    const std::string& config = asked->track->config.hash;
    KeptBoards& kept = asked->at_ms == 0 && config == asked->config_in_force ? now_ : others_;
    const KeptBoards::Key key{config, asked->config_in_force, asked->board, asked->view(),
                              asked->at_ms};
    const int64_t changes = reader.BoardChanges();
    answer.text = kept.Find(key, changes);
    if (answer.text != nullptr) return absl::OkStatus();
    absl::StatusOr<std::string> text = MakeStatisticsText(reader, context_, *asked);
    if (!text.ok()) return text.status();
    answer.text = std::make_shared<const std::string>(*std::move(text));
    kept.Keep(key, changes, answer.text);
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

}  // namespace myograde::server
