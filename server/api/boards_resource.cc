#include "server/api/resources.h"

#include <map>
#include <memory>
#include <string>
#include <tuple>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/api/board_feeds.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/board_view.h"
#include "server/api/kept_boards.h"
#include "server/api/redaction.h"
#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"
#include "server/http/http_server.h"

namespace myograde::server {
namespace {

// Answers about boards, which are kept until the store changes. Safe from any thread.
class BoardAnswers {
 public:
  // What is said of a board.
  using Make =
      std::function<absl::StatusOr<Json>(const Transaction& reader, const BoardQuery& asked)>;

  // `context` must outlive it.
  BoardAnswers(const ApiContext& context, Make make) : context_(context), make_(std::move(make)) {}

  // The answer about the board that a request asks for; it has the parameters of boards alone.
  ApiResult Get(const Request& request) {
    return context_.readers.Read<ApiAnswer>([&](const Transaction& reader) -> ApiResult {
      ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context_));
      ApiAnswer answer{.tagged = true};
      ASSIGN_OR_RETURN(answer.text, TextOf(reader, asked));
      answer.for_all_origins = IsPhasePublic(reader, context_, asked.track->config.phase);
      return answer;
    });
  }

  // The text of that answer.
  absl::StatusOr<KeptBoards::Text> TextOf(const Transaction& reader, const BoardQuery& asked) {
    const std::string& config = asked.track->config.hash;
    KeptBoards& kept = asked.at_ms == 0 && config == asked.config_in_force ? now_ : others_;
    const std::string key = absl::StrJoin(
        std::tuple(config, asked.config_in_force, asked.board, asked.view(), asked.at_ms), "/");
    const int64_t changes = reader.BoardChanges();
    if (auto found = kept.Find(key, changes); found != nullptr) return found;
    ASSIGN_OR_RETURN(const Json made, make_(reader, asked));
    const auto text = std::make_shared<const std::string>(CanonicalJson(made) + "\n");
    kept.Keep(key, changes, text);
    return text;
  }

 private:
  const ApiContext& context_;
  const Make make_;
  // Apart, as boards of the past are asked for without end.
  KeptBoards now_{256, size_t{256} << 20};
  KeptBoards others_{32, size_t{32} << 20};
};

using Answers = std::shared_ptr<BoardAnswers>;

// What may be kept as long as its holder asks whether it is still current.
void SendFresh(std::string text, const char* type, Response& response) {
  response.SetHeader("Cache-Control", "no-cache");
  response.SetHeader("X-Content-Type-Options", "nosniff");
  response.SetContent(std::move(text), type);
}

absl::Status MissingParameter(const char* key, const char* what) {
  return absl::InvalidArgumentError(absl::StrCat("\"", key, "\" is missing: ", what));
}

absl::Status SendBadge(const ApiContext& context, const Answers& answers, const Request& request,
                       Response& response) {
  return context.readers.Read([&](const Transaction& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context, {"team"}));
    if (!request.HasParam("team")) return MissingParameter("team", "the name of a team");
    ASSIGN_OR_RETURN(const auto text, answers->TextOf(reader, asked));
    ASSIGN_OR_RETURN(std::string badge,
                     DrawBadge(Json::parse(*text), reader.teams.NameOf(request.Param("team"))));
    // Opened by itself, an image runs nothing and loads nothing either.
    response.SetHeader("Content-Security-Policy", "default-src 'none'; sandbox");
    SendFresh(std::move(badge), "image/svg+xml", response);
    return absl::OkStatus();
  });
}

absl::Status SendFeed(const ApiContext& context, const Answers& answers, const Request& request,
                      Response& response) {
  return context.readers.Read([&](const Transaction& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context));
    ASSIGN_OR_RETURN(const auto text, answers->TextOf(reader, asked));
    const Json board = Json::parse(*text);
    std::map<int64_t, std::string> ended;
    for (const Json& row : board["rows"]) {
      const auto evaluation = row["evaluation"].get<int64_t>();
      const absl::StatusOr<EvaluationRow> found = reader.evaluations.Find(evaluation);
      if (ExtractDamage(found.status()).has_value()) continue;  // the others are good
      if (!found.ok()) return found.status();
      ended[evaluation] = TimeToJson(found->finished_at).get<std::string>();
    }
    const Json last = TimeToJson(reader.Board().ChangedAt(
        asked.track->config.hash, asked.track->config.phase, asked.moment()));
    const std::string changed = last.is_null() ? "1970-01-01T00:00:00.000Z"  // an empty board
                                               : last.get<std::string>();
    SendFresh(WriteFeed(board, changed, ended), "application/atom+xml", response);
    return absl::OkStatus();
  });
}

ApiResult ExplainPlaces(const ApiContext& context, const Transaction& reader,
                        const Request& request) {
  ASSIGN_OR_RETURN(const BoardQuery board, ParseBoardQuery(request, reader, context, {"a", "b"}));
  for (const char* key : {"a", "b"}) {
    if (request.HasParam(key)) continue;
    return MissingParameter(key, "the number of a submission or the name of a team");
  }
  ASSIGN_OR_RETURN(const BoardSource source, SourceOf(reader, *board.track, board.moment()));
  ASSIGN_OR_RETURN(const auto explanation,
                   ExplainOrder(source.standings, source.marks, board.rules->rules,
                                board.track->scoring, reader.teams.NameOf(request.Param("a")),
                                reader.teams.NameOf(request.Param("b"))));
  return ApiAnswer{.body = {{"track", board.track->config.id},
                            {"profile", board.track->config.profile},
                            {"phase", TextOrNull(board.track->config.phase)},
                            {"board", board.board},
                            {"above", RowToJson(explanation.above)},
                            {"below", RowToJson(explanation.below)},
                            {"why", explanation.sentence}},
                   .tagged = true};
}

ApiResult RebuildBoards(const ApiContext& context, const Request&, const Json& body) {
  RETURN_IF_ERROR(ParseNothing(body));
  HttpServer::AllowUploadTime();
  ASSIGN_OR_RETURN(const Standings made, RewriteStandings(context, /*missing_only=*/false));
  NoteAct("boards", absl::StrCat(made.rows.size(), " rows are rebuilt"));
  return ApiAnswer{200,
                   {{"rebuilt", made.rows.size()}, {"unreadable", DamagedToJson(made.damaged)}}};
}

}  // namespace

void AddBoards(Routes& routes, const ApiContext& context) {
  const auto kept = std::make_shared<KeptStatistics>();
  // The answers that BoardView or StatisticsView makes.
  const auto answers = [&](auto view) {
    return std::make_shared<BoardAnswers>(context, [&context, kept, view](const Transaction& reader,
                                                                          const BoardQuery& asked) {
      return view(reader, asked, FindStatisticsConfig(context, asked.track->config.phase), *kept);
    });
  };
  const Answers boards = answers(BoardView);
  const Answers tests = answers(StatisticsView);
  routes.Get("/v1/leaderboard", Action::kReadBoard, std::bind_front(&BoardAnswers::Get, boards));
  routes.GetFile("/v1/leaderboard/badge", Action::kReadBoard,
                 std::bind_front(SendBadge, std::cref(context), boards));
  routes.GetFile("/v1/leaderboard/feed", Action::kReadBoard,
                 std::bind_front(SendFeed, std::cref(context), boards));
  routes.Get("/v1/leaderboard/explain", Action::kReadBoard, Bind(context, ExplainPlaces));
  routes.Get("/v1/leaderboard/statistics", Action::kReadBoard,
             std::bind_front(&BoardAnswers::Get, tests));
  routes.Post("/v1/leaderboard/rebuild", Action::kRebuildBoards, Bind(context, RebuildBoards));
}

}  // namespace myograde::server
