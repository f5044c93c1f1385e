#include "server/api/resources.h"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/board_answers.h"
#include "server/api/board_feeds.h"
#include "server/api/board_query.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/board_view.h"
#include "server/api/kept_statistics.h"
#include "server/api/requests.h"
#include "server/api/statistics_view.h"
#include "server/api/http_server.h"
#include "server/api/views.h"
#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using Answers = std::shared_ptr<BoardAnswers>;

// Opened by itself, an image runs nothing and loads nothing either.
void SendDrawing(const std::string& svg, Response& response) {
  response.SetHeader("Cache-Control", "no-cache");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  response.SetHeader("Content-Security-Policy", "default-src 'none'; sandbox");
  response.SetContent(svg, "image/svg+xml");
}

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

absl::Status SendBadge(const ApiContext& context, const Answers& answers, const Request& request,
                       Response& response) {
  absl::Status status = CheckParameters(request, BoardParametersAnd({"team"}));
  if (!request.HasParam("team")) {
    status.Update(absl::InvalidArgumentError("\"team\" is missing: the name of a team"));
  }
  RETURN_IF_ERROR(status);
  return context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context));
    ASSIGN_OR_RETURN(const auto text, answers->TextOf(reader, asked));
    ASSIGN_OR_RETURN(const auto badge,
                     BadgeOf(Json::parse(*text), reader.TeamOf(request.Param("team"))));
    SendDrawing(badge, response);
    return absl::OkStatus();
  });
}

absl::Status SendFeed(const ApiContext& context, const Answers& answers, const Request& request,
                      Response& response) {
  RETURN_IF_ERROR(CheckParameters(request, BoardParametersAnd({})));
  return context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context));
    ASSIGN_OR_RETURN(const auto text, answers->TextOf(reader, asked));
    const Json board = Json::parse(*text);
    std::map<int64_t, std::string> ended;
    for (const Json& row : board["rows"]) {
      const auto evaluation = row["evaluation"].get<int64_t>();
      const absl::StatusOr<EvaluationRow> found = reader.Evaluation(evaluation);
      if (DamageOf(found.status()).has_value()) continue;  // the others are good
      if (!found.ok()) return found.status();
      ended[evaluation] = TimeToJson(found->finished_at).get<std::string>();
    }
    const Json last = TimeToJson(reader.BoardChangedAt(
        asked.track->config.hash, asked.track->config.phase, asked.moment()));
    const std::string changed = last.is_null() ? "1970-01-01T00:00:00.000Z"  // an empty board
                                               : last.get<std::string>();
    response.SetHeader("Cache-Control", "no-cache");
    response.SetHeader("X-Content-Type-Options", "nosniff");
    response.SetContent(FeedOf(board, changed, ended), "application/atom+xml");
    return absl::OkStatus();
  });
}

ApiResult ExplainPlaces(const ApiContext& context, const Request& request) {
  absl::Status status = CheckParameters(request, BoardParametersAnd({"a", "b"}));
  for (const char* key : {"a", "b"}) {
    if (!request.HasParam(key)) {
      status.Update(absl::InvalidArgumentError(absl::StrCat(
          "\"", key, "\" is missing: the number of a submission, or the name of a team")));
    }
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery board, ParseBoardQuery(request, reader, context));
    ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, *board.track, board.moment()));
    ASSIGN_OR_RETURN(const auto explanation,
                     ExplainOrder(source.standings, source.marks, board.rules->rules,
                                  board.track->scoring.team,
                                  reader.TeamOf(request.Param("a")),
                                  reader.TeamOf(request.Param("b"))));
    answer.body = {{"track", board.track->config.id},
                   {"profile", board.track->config.profile},
                   {"phase", TextOrNull(board.track->config.phase)},
                   {"board", board.board},
                   {"above", RowToJson(explanation.above)},
                   {"below", RowToJson(explanation.below)},
                   {"why", explanation.sentence}};
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult RebuildBoards(const ApiContext& context, const Request&, const Json& body) {
  ConfigReader reader(body, "request");
  RETURN_IF_ERROR(reader.Finish());
  HttpServer::AllowUploadTime();
  ASSIGN_OR_RETURN(auto standings, MakeStandings(context.readers, /*missing_only=*/false));
  const size_t count = standings.rows.size();
  const Json unreadable = DamagedToJson(standings.damaged);
  // One that ends in between is made of its rows whenever a board needs it.
  RETURN_IF_ERROR(context.engine.Change(
      [rows = std::move(standings.rows)](Writer& writer) {
        absl::Status written = writer.DropStandings();
        for (const auto& [evaluation, standing] : rows) {
          written.Update(writer.SetStanding(evaluation, standing));
        }
        return written;
      },
      context.config.http.upload));
  NoteAct("boards", absl::StrCat(count, " rows are rebuilt"));
  return ApiAnswer{200, {{"rebuilt", count}, {"unreadable", unreadable}}};
}

}  // namespace

void AddBoards(Routes& routes, const ApiContext& context) {
  const auto statistics = std::make_shared<KeptStatistics>();
  const auto boards = std::make_shared<BoardAnswers>(
      context, [&context, statistics](Reader& reader, const BoardQuery& asked) {
        const absl::StatusOr<Json> board = BoardView(
            reader, asked, StatisticsConfigOf(context, asked.track->config.phase), *statistics);
        return board.ok() ? CanonicalJson(*board) + "\n"
                          : absl::StatusOr<std::string>(board.status());
      });
  const auto tests = std::make_shared<BoardAnswers>(
      context, [&context, statistics](Reader& reader, const BoardQuery& asked) {
        return MakeStatisticsText(reader, context, asked, *statistics);
      });
  routes.Get("/v1/leaderboard", Action::kReadBoard, std::bind_front(&BoardAnswers::Get, boards));
  routes.GetFile("/v1/leaderboard/badge", Action::kReadBoard,
                 std::bind_front(SendBadge, std::cref(context), boards));
  routes.GetFile("/v1/leaderboard/feed", Action::kReadBoard,
                 std::bind_front(SendFeed, std::cref(context), boards));
  routes.Get("/v1/leaderboard/explain", Action::kReadBoard,
             std::bind_front(ExplainPlaces, std::cref(context)));
  routes.Get("/v1/leaderboard/statistics", Action::kReadBoard,
             std::bind_front(&BoardAnswers::Get, tests));
  routes.Post("/v1/leaderboard/rebuild", Action::kRebuildBoards,
              std::bind_front(RebuildBoards, std::cref(context)));
}

}  // namespace myograde::server
