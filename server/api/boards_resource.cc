#include "server/api/boards_resource.h"

#include <functional>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "server/api/board_query.h"
#include "server/api/board_source.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/engine/standings.h"
#include "server/grading/leaderboard.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json RowToJson(const LeaderboardRow& row) {
  const bool baseline = row.ranked.rank == 0;
  return {{"rank", baseline ? Json() : Json(row.ranked.rank)},
          {"baseline", baseline},
          {"team", row.source.team},
          {"submission", row.source.submission},
          {"evaluation", row.source.evaluation},
          {"name", row.source.artefact_name},
          {"qualified", row.qualified},
          {"aggregate", row.aggregate}};
}

// The numbers that the board shows beside the successes.
Json ColumnsToJson(const scoring::ScoredTrack& track, const scoring::BoardSpec& board) {
  Json columns = Json::array();
  for (const size_t place : board.columns) columns.push_back(MetricToJson(track.metrics[place]));
  return columns;
}

Json BoardToJson(const Leaderboard& board) {
  Json rows = Json::array();
  for (const LeaderboardRow& row : board.rows) rows.push_back(RowToJson(row));
  Json disqualified = Json::array();
  for (const DisqualifiedRow& row : board.disqualified) {
    disqualified.push_back({{"team", row.source.team},
                            {"submission", row.source.submission},
                            {"evaluation", row.source.evaluation},
                            {"name", row.source.artefact_name},
                            {"reason", row.mark.why},
                            {"at", TimeToJson(row.mark.at)},
                            {"aggregate", row.aggregate}});
  }
  return {{"rows", std::move(rows)}, {"disqualified", std::move(disqualified)}};
}

absl::StatusOr<std::string> MakeBoardText(Reader& reader, const BoardQuery& asked) {
  const TrackConfig& config = asked.track->config;
  absl::StatusOr<BoardSource> source = SourceOf(reader, *asked.track, asked.before_ms());
  if (!source.ok()) return source.status();
  absl::StatusOr<Leaderboard> board = MakeLeaderboard(
      source->standings, source->marks, asked.rules->rules, asked.track->scoring.team);
  if (!board.ok()) return board.status();
  Json json = BoardToJson(*board);
  source->damaged.insert(source->damaged.end(), board->damaged.begin(), board->damaged.end());
  json["unreadable"] = DamagedToJson(source->damaged);
  json["track"] = config.id;
  json["track_kind"] = config.kind->name;
  json["profile"] = config.profile;
  json["phase"] = TextOrNull(config.phase);
  json["frozen_at"] =
      asked.frozen || source->withheld ? TimeToJson(absl::ToUnixMillis(asked.freezes)) : Json();
  json["complete"] = asked.whole || !(asked.frozen || source->withheld);
  json["board"] = asked.board;
  json["rules"] = config.scoring["boards"][asked.board];
  json["official_figures"] = asked.track->scoring.official_figures;
  json["columns"] = ColumnsToJson(*asked.track->scoring.track, *asked.rules);
  json["order"] = scoring::DescribeOrder(asked.rules->rules);
  json["config"] = config.hash;
  json["episodes"] = config.seeds.size();
  json["other_config"] = 
      reader.RankedElsewhere(config.id, config.profile, config.phase, config.hash);
  return CanonicalJson(json) + "\n";
}

}  // namespace

void BoardsResource::Install(Routes& routes) {
  routes.Get("/v1/leaderboard", Action::kReadBoard, std::bind_front(&BoardsResource::Get, this));
  routes.Get("/v1/leaderboard/explain", Action::kReadBoard,
             std::bind_front(&BoardsResource::Explain, this));
  routes.Post("/v1/leaderboard/rebuild", Action::kRebuildBoards,
              std::bind_front(&BoardsResource::Rebuild, this));
}

ApiResult BoardsResource::Get(const httplib::Request& request) {
  absl::Status status = CheckParameters(request, {"track", "profile", "phase", "board"});
  if (!status.ok()) return ErrorOf(status);
  ApiAnswer answer{.tagged = true};
  status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    const absl::StatusOr<BoardQuery> asked = ParseBoardQuery(request, reader, context_);
    if (!asked.ok()) return asked.status();
    const Key key(asked->track->config.hash, asked->board, asked->view());
    const int64_t changes = reader.BoardChanges();
    answer.text = Kept(key, changes);
    if (answer.text != nullptr) return absl::OkStatus();
    absl::StatusOr<std::string> text = MakeBoardText(reader, *asked);
    if (!text.ok()) return text.status();
    answer.text = std::make_shared<const std::string>(*std::move(text));
    Keep(key, {changes, answer.text});
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

std::shared_ptr<const std::string> BoardsResource::Kept(const Key& key, int64_t changes) {
  const MutexLock lock(mutex_);
  const KeptBoard& kept = kept_[key];
  return kept.changes == changes ? kept.text : nullptr;
}

void BoardsResource::Keep(const Key& key, KeptBoard board) {
  const MutexLock lock(mutex_);
  KeptBoard& kept = kept_[key];
  if (board.changes > kept.changes) kept = std::move(board);
}

ApiResult BoardsResource::Explain(const httplib::Request& request) const {
  absl::Status status = CheckParameters(request, {"track", "profile", "phase", "board", "a", "b"});
  for (const char* key : {"a", "b"}) {
    if (!request.has_param(key)) {
      status.Update(absl::InvalidArgumentError(absl::StrCat(
          "\"", key, "\" is missing: the number of a submission, or the name of a team")));
    }
  }
  if (!status.ok()) return ErrorOf(status);
  ApiAnswer answer{.tagged = true};
  status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    const absl::StatusOr<BoardQuery> asked = ParseBoardQuery(request, reader, context_);
    if (!asked.ok()) return asked.status();
    const BoardQuery& board = *asked;
    const absl::StatusOr<BoardSource> source = SourceOf(reader, *board.track, board.before_ms());
    if (!source.ok()) return source.status();
    const auto explanation = ExplainOrder(source->standings, source->marks, board.rules->rules,
                                          board.track->scoring.team,
                                          reader.TeamOf(request.get_param_value("a")),
                                          reader.TeamOf(request.get_param_value("b")));
    if (!explanation.ok()) return explanation.status();
    answer.body = {{"track", board.track->config.id},
                   {"profile", board.track->config.profile},
                   {"phase", TextOrNull(board.track->config.phase)},
                   {"board", board.board},
                   {"above", RowToJson(explanation->above)},
                   {"below", RowToJson(explanation->below)},
                   {"why", explanation->sentence}};
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

ApiResult BoardsResource::Rebuild(const httplib::Request&, const Json& body) const {
  ConfigReader reader(body, "request");
  if (absl::Status status = reader.Finish(); !status.ok()) return ErrorOf(status);
  UnixHttpServer::AllowUploadTime();
  auto standings = MakeStandings(context_.readers, /*missing_only=*/false);
  if (!standings.ok()) return ErrorOf(standings.status());
  const size_t count = standings->rows.size();
  const Json unreadable = DamagedToJson(standings->damaged);
  // One that ends in between is made of its rows whenever a board needs it.
  const absl::Status status = context_.engine.Change(
      [rows = std::move(standings->rows)](Writer& writer) {
        absl::Status written = writer.DropStandings();
        for (const auto& [evaluation, standing] : rows) {
          written.Update(writer.SetStanding(evaluation, standing));
        }
        return written;
      },
      context_.config.http.upload);
  if (!status.ok()) return ErrorOf(status);
  NoteAct("boards", absl::StrCat(count, " rows are rebuilt"));
  return ApiAnswer{200, {{"rebuilt", count}, {"unreadable", unreadable}}};
}

}  // namespace myograde::server
