#include "server/api/boards_resource.h"

#include <functional>
#include <map>
#include <optional>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/board_feeds.h"
#include "server/api/board_query.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/board_view.h"
#include "server/api/requests.h"
#include "server/api/unix_http_server.h"
#include "server/api/views.h"
#include "server/engine/standings.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {

using Json = nlohmann::json;

namespace {

// Opened by itself, an image runs nothing and loads nothing either.
void SendDrawing(const std::string& svg, Response& response) {
  response.SetHeader("Cache-Control", "no-cache");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  response.SetHeader("Content-Security-Policy", "default-src 'none'; sandbox");
  response.SetContent(svg, "image/svg+xml");
}

}  // namespace

BoardsResource::BoardsResource(const ApiContext& context, KeptStatistics& statistics)
    : context_(context),
      answers_(context, [&context, &statistics](Reader& reader, const BoardQuery& asked) {
        const absl::StatusOr<Json> board = BoardView(
            reader, asked, StatisticsConfigOf(context, asked.track->config.phase), statistics);
        return board.ok() ? CanonicalJson(*board) + "\n"
                          : absl::StatusOr<std::string>(board.status());
      }) {}

void BoardsResource::Install(Routes& routes) {
  routes.Get("/v1/leaderboard", Action::kReadBoard, std::bind_front(&BoardsResource::Get, this));
  routes.GetFile("/v1/leaderboard/badge", Action::kReadBoard,
                 std::bind_front(&BoardsResource::Badge, this));
  routes.GetFile("/v1/leaderboard/feed", Action::kReadBoard,
                 std::bind_front(&BoardsResource::Feed, this));
  routes.Get("/v1/leaderboard/explain", Action::kReadBoard,
             std::bind_front(&BoardsResource::Explain, this));
  routes.Post("/v1/leaderboard/rebuild", Action::kRebuildBoards,
              std::bind_front(&BoardsResource::Rebuild, this));
}

absl::Status BoardsResource::Badge(const Request& request, Response& response) {
  absl::Status status = CheckParameters(request, BoardParametersAnd({"team"}));
  if (!request.HasParam("team")) {
    status.Update(absl::InvalidArgumentError("\"team\" is missing: the name of a team"));
  }
  RETURN_IF_ERROR(status);
  return context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context_));
    ASSIGN_OR_RETURN(const auto text, answers_.TextOf(reader, asked));
    ASSIGN_OR_RETURN(const auto badge,
                     BadgeOf(Json::parse(*text), reader.TeamOf(request.Param("team"))));
    SendDrawing(badge, response);
    return absl::OkStatus();
  });
}

absl::Status BoardsResource::Feed(const Request& request, Response& response) {
  RETURN_IF_ERROR(CheckParameters(request, BoardParametersAnd({})));
  return context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context_));
    ASSIGN_OR_RETURN(const auto text, answers_.TextOf(reader, asked));
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

ApiResult BoardsResource::Get(const Request& request) { return answers_.Get(request); }

ApiResult BoardsResource::Explain(const Request& request) const {
  absl::Status status = CheckParameters(request, BoardParametersAnd({"a", "b"}));
  for (const char* key : {"a", "b"}) {
    if (!request.HasParam(key)) {
      status.Update(absl::InvalidArgumentError(absl::StrCat(
          "\"", key, "\" is missing: the number of a submission, or the name of a team")));
    }
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery board, ParseBoardQuery(request, reader, context_));
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

ApiResult BoardsResource::Rebuild(const Request&, const Json& body) const {
  ConfigReader reader(body, "request");
  RETURN_IF_ERROR(reader.Finish());
  UnixHttpServer::AllowUploadTime();
  ASSIGN_OR_RETURN(auto standings, MakeStandings(context_.readers, /*missing_only=*/false));
  const size_t count = standings.rows.size();
  const Json unreadable = DamagedToJson(standings.damaged);
  // One that ends in between is made of its rows whenever a board needs it.
  RETURN_IF_ERROR(context_.engine.Change(
      [rows = std::move(standings.rows)](Writer& writer) {
        absl::Status written = writer.DropStandings();
        for (const auto& [evaluation, standing] : rows) {
          written.Update(writer.SetStanding(evaluation, standing));
        }
        return written;
      },
      context_.config.http.upload));
  NoteAct("boards", absl::StrCat(count, " rows are rebuilt"));
  return ApiAnswer{200, {{"rebuilt", count}, {"unreadable", unreadable}}};
}

}  // namespace myograde::server
