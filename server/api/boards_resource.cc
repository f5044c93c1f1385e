#include "server/api/boards_resource.h"

#include <functional>
#include <optional>
#include <set>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/engine/standings.h"
#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Everything that may stand on a board, and what can't be read of it.
struct Source {
  std::vector<StandingRow> standings;
  Marks marks;
  std::vector<Damage> damaged;
  bool withheld = false;  // some were left out
};

// What the view lacks, or has of other numbers than today's, is made of the episode rows on the
// spot.
absl::Status FillRow(Reader& reader, const std::string& names, StandingRow& row) {
  if (!row.standing.aggregate_json.empty() && row.standing.ranked.names == names) {
    return absl::OkStatus();
  }
  absl::StatusOr<Standing> standing = ReadStanding(reader, row.evaluation);
  if (!standing.ok()) return standing.status();
  row.standing = *std::move(standing);
  return absl::OkStatus();
}

// `before_ms`: what ended from then on is left out.
absl::StatusOr<Source> SourceOf(Reader& reader, const Track& track, int64_t before_ms) {
  const std::string names = scoring::RankedNames(*track.scoring.track);
  Listed<StandingRow> listed = reader.Standings(track.config.hash);
  MarksInForce marks = reader.Marks();
  Source source{{}, std::move(marks.by_submission), std::move(listed.damaged)};
  const bool choose = track.scoring.team == scoring::TeamRule::kChosen;
  const std::set<int64_t> chosen =
      choose ? reader.Choices(track.config.hash, before_ms) : std::set<int64_t>();
  for (StandingRow& row : listed.rows) {
    if (row.finished_at >= before_ms) {
      source.withheld = true;
      continue;
    }
    row.chosen = chosen.contains(row.submission);
    // Nobody can tell whether it is hidden or disqualified.
    if (const auto mark = marks.damaged.find(row.submission); mark != marks.damaged.end()) {
      source.damaged.push_back(mark->second);
      continue;
    }
    const absl::Status filled = FillRow(reader, names, row);
    if (filled.ok()) {
      source.standings.push_back(std::move(row));
    } else if (const std::optional<Damage> damage = DamageOf(filled)) {
      source.damaged.push_back(*damage);
    } else {
      return filled;
    }
  }
  if (const auto mark = marks.damaged.find(0); mark != marks.damaged.end()) {
    source.damaged.push_back(mark->second);
  }
  return source;
}

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

// The track and board that a request names.
struct BoardQuery {
  TrackPtr track;
  std::string board;
  const scoring::BoardSpec* rules = nullptr;  // the track's
  // When its phase freezes it, as long as that has not been undone.
  absl::Time freezes = absl::InfiniteFuture();
  bool frozen = false;  // by the calendar
  bool whole = true;    // the caller sees all of it

  // What ended from then on is not shown. However the calendar is set, a row that is as late as the
  // freeze stays hidden.
  int64_t before_ms() const { return whole ? INT64_MAX : absl::ToUnixMillis(freezes); }
  // Boards of one config that look different.
  int view() const { return (frozen ? 2 : 0) + (whole ? 1 : 0); }
};

// A phase that no file describes any more is found by its submissions.
absl::StatusOr<TrackPtr> TrackOfPhase(Reader& reader, const ApiContext& context,
                                      const std::string& name) {
  const absl::StatusOr<PhasePtr> phase = context.phases.Find(name);
  if (phase.ok()) return (*phase)->track;
  const std::string config = reader.ConfigOfPhase(name);
  if (config.empty()) return phase.status();
  return StoredTrack(reader, config);
}

absl::StatusOr<TrackPtr> AskedTrack(const httplib::Request& request, Reader& reader,
                                    const ApiContext& context) {
  const std::string name = request.get_param_value("track");
  const std::string profile = request.get_param_value("profile");
  if (!request.has_param("phase")) {
    if (request.has_param("track")) return context.tracks.Find(name, profile);
    return absl::InvalidArgumentError(
        "\"track\" is missing: a board is of one track, or of one \"phase\"");
  }
  absl::StatusOr<TrackPtr> track =
      TrackOfPhase(reader, context, request.get_param_value("phase"));
  if (!track.ok()) return track.status();
  const TrackConfig& config = (*track)->config;
  if ((name.empty() || name == config.id) && (profile.empty() || profile == config.profile)) {
    return track;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("phase \"", config.phase, "\" is of track \"", config.id,
                   "\" in the profile \"", config.profile, "\""));
}

// From a phase's freeze on, only organisers see what ends later.
absl::Status AddFreeze(Reader& reader, const ApiContext& context, BoardQuery& asked) {
  const PhaseConfig* phase = context.phases.ConfigOf(asked.track->config.phase);
  if (phase == nullptr) return absl::OkStatus();
  const auto events = reader.PhaseEvents(phase->name);
  if (!events.ok()) return events.status();
  const PhaseStatus status = StatusOfPhase(*phase, *events, context.clock.Now());
  const bool ever = phase->freezes != absl::InfiniteFuture();
  if (!ever || status.published || status.revealed) return absl::OkStatus();
  asked.freezes = phase->freezes;
  asked.frozen = status.frozen;
  asked.whole = CallerIsOrganiser();
  return absl::OkStatus();
}

absl::StatusOr<BoardQuery> ParseBoardQuery(const httplib::Request& request, Reader& reader,
                                           const ApiContext& context) {
  absl::StatusOr<TrackPtr> track = AskedTrack(request, reader, context);
  if (!track.ok()) return track.status();
  BoardQuery asked{*track, request.has_param("board") ? request.get_param_value("board")
                                                      : scoring::kMainBoard};
  const auto rules = asked.track->scoring.boards.find(asked.board);
  if (rules == asked.track->scoring.boards.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("track \"", asked.track->config.id, "\" has no board \"", asked.board, "\""));
  }
  asked.rules = &rules->second;
  if (absl::Status status = AddFreeze(reader, context, asked); !status.ok()) return status;
  return asked;
}

absl::StatusOr<std::string> MakeBoardText(Reader& reader, const BoardQuery& asked) {
  const TrackConfig& config = asked.track->config;
  absl::StatusOr<Source> source = SourceOf(reader, *asked.track, asked.before_ms());
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
    const absl::StatusOr<Source> source = SourceOf(reader, *board.track, board.before_ms());
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
