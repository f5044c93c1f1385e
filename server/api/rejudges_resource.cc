#include "server/api/resources.h"

#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "scoring/track.h"
#include "server/api/board_source.h"
#include "server/api/board_view.h"
#include "server/api/rejudge_plan.h"
#include "server/api/requests.h"
#include "server/api/views.h"
#include "server/base/json_value.h"
#include "server/challenge/phases.h"
#include "server/engine/rejudges.h"
#include "server/grading/results.h"

namespace myograde::server {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RejudgePlan, submissions, facts, play, without_files)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RepeatRow, index, repetition, differs)

namespace {

Json SummaryOf(const RejudgeRow& rejudge, const RejudgeProgress& progress) {
  Json json = RejudgeKeys(rejudge);
  json.update({{"at", TimeToJson(rejudge.at)},
               {"state", EnumName(progress.state)},
               {"complete", progress.complete},
               {"who", rejudge.who},
               {"reason", rejudge.why},
               {"submissions", progress.submissions},
               {"items",
                {{"total", progress.items + progress.missing},
                 {"ended", progress.ended},
                 {"facts", progress.facts},
                 {"play", progress.play}}},
               {"episodes", {{"total", progress.episodes}, {"done", progress.episodes_done}}}});
  return json;
}

Json EventToJson(const RejudgeEventRow& event) {
  return {{"event", EnumName(event.event)},
          {"at", TimeToJson(event.at)},
          {"who", event.who},
          {"reason", event.why},
          {"document", event.document},
          {"signature", event.signature}};
}

// Today's name of a submission's team; null if it can't be read.
Json TeamToJson(const Transaction& reader, int64_t submission) {
  const absl::StatusOr<std::string> team = reader.submissions.TeamOf(submission);
  return team.ok() ? Json(*team) : Json();
}

Json WithoutResultToJson(const Transaction& reader, const RejudgeProgress& progress) {
  Json without = Json::array();
  for (const EvaluationRow& item : progress.without_result) {
    without.push_back({{"submission", item.submission},
                       {"team", TeamToJson(reader, item.submission)},
                       {"evaluation", item.id},
                       {"state", EnumName(item.state)},
                       {"reason", TextOrNull(item.reason)}});
  }
  return without;
}

Json RejudgedRow(const LeaderboardRow& row) {
  Json json = RowToJson(row);
  for (const char* key : {"rank_by_rules", "rejudge", "team"}) json.erase(key);
  return json;
}

// A team has one ranked row; its baselines are rows of their own.
using RowKey = std::tuple<std::string, int64_t>;
RowKey KeyOf(const LeaderboardRow& row) {
  return {row.source.team, row.ranked.rank == 0 ? row.source.submission : 0};
}

// Every row of two boards of the same teams: in the order of the new one, and then what is gone.
Json CompareBoards(const Leaderboard& before, const Leaderboard& after, int64_t& moved) {
  std::map<RowKey, const LeaderboardRow*> old;
  for (const LeaderboardRow& row : before.rows) old.emplace(KeyOf(row), &row);
  Json rows = Json::array();
  for (const LeaderboardRow& row : after.rows) {
    const auto was = old.find(KeyOf(row));
    const bool there = was != old.end();
    if (!there || was->second->ranked.rank != row.ranked.rank) ++moved;
    rows.push_back({{"team", row.source.team},
                    {"before", there ? RejudgedRow(*was->second) : Json()},
                    {"after", RejudgedRow(row)}});
    if (there) old.erase(was);
  }
  for (const LeaderboardRow& row : before.rows) {
    if (!old.contains(KeyOf(row))) continue;
    ++moved;
    rows.push_back({{"team", row.source.team}, {"before", RejudgedRow(row)}, {"after", nullptr}});
  }
  return rows;
}

// Before and after the moment of its application, or of now.
std::pair<BoardMoment, BoardMoment> MomentsOf(const RejudgeRow& rejudge) {
  if (rejudge.last() != RejudgeEvent::kApplied) return {{}, {.assumed_rejudge = rejudge.id}};
  const int64_t at = rejudge.events.back().at;
  return {{.before_ms = at}, {.before_ms = at + 1, .assumed_rejudge = rejudge.id}};
}

absl::StatusOr<Leaderboard> BoardOrEmpty(const BoardSource& source, const Track& track,
                                         const std::string& name) {
  const auto board = track.scoring.boards.find(name);
  if (board == track.scoring.boards.end()) return Leaderboard();
  return BoardOf(source, track, board->second.rules);
}

absl::StatusOr<Json> BoardChanges(const BoardSource& old, const BoardSource& now, const Track& from,
                                  const Track& to, const std::string& name) {
  ASSIGN_OR_RETURN(const Leaderboard before, BoardOrEmpty(old, from, name));
  ASSIGN_OR_RETURN(const Leaderboard after, BoardOrEmpty(now, to, name));
  int64_t moved = 0;
  Json rows = CompareBoards(before, after, moved);
  const bool stays = to.scoring.boards.contains(name);
  const Track& shown = stays ? to : from;
  const scoring::BoardSpec& board = shown.scoring.boards.at(name);
  return Json{{"board", name},
              {"order", stays ? Json(scoring::DescribeOrder(board.rules)) : Json()},
              {"columns", ColumnsToJson(*shown.scoring.track, board)},
              {"moved", moved},
              {"rows", std::move(rows)}};
}

absl::StatusOr<Json> NotRepeatableToJson(const Transaction& reader, int64_t rejudge) {
  ASSIGN_OR_RETURN(const auto found, reader.rejudges.ListUnrepeatable(rejudge));
  Json list = Json::array();
  for (const auto& [submission, episodes] : found) {
    list.push_back({{"submission", submission},
                    {"team", TeamToJson(reader, submission)},
                    {"episodes", episodes}});
  }
  return list;
}

// With the events, what has no result, and the keys at which the configs differ.
absl::StatusOr<Json> WholeRejudgeToJson(const Transaction& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const RejudgeProgress progress, reader.rejudges.CountProgress(rejudge));
  Json json = SummaryOf(rejudge, progress);
  json["without_result"] = WithoutResultToJson(reader, progress);
  json["events"] = Json::array();
  for (const RejudgeEventRow& event : rejudge.events) json["events"].push_back(EventToJson(event));
  ASSIGN_OR_RETURN(const std::string from, reader.content.Text(kConfigs, rejudge.from_config));
  ASSIGN_OR_RETURN(const std::string to, reader.content.Text(kConfigs, rejudge.to_config));
  json["differs"] = DifferingKeys(Json::parse(from), Json::parse(to));
  return json;
}

// Adds how the boards change, and what was not repeatable.
absl::Status AddRejudgeChanges(const Transaction& reader, const RejudgeRow& rejudge, Json& json) {
  json["boards"] = json["unreadable"] = Json::array();
  ASSIGN_OR_RETURN(json["not_repeatable"], NotRepeatableToJson(reader, rejudge.id));
  if (rejudge.purpose != RejudgePurpose::kRules) return absl::OkStatus();
  ASSIGN_OR_RETURN(const TrackPtr from, StoredTrack(reader, rejudge.from_config));
  ASSIGN_OR_RETURN(const TrackPtr to, StoredTrack(reader, rejudge.to_config));
  const auto [before, after] = MomentsOf(rejudge);
  ASSIGN_OR_RETURN(const BoardSource old, SourceOf(reader, *from, before));
  ASSIGN_OR_RETURN(const BoardSource now, SourceOf(reader, *to, after));
  auto names = from->scoring.boards;
  names.insert(to->scoring.boards.begin(), to->scoring.boards.end());
  for (const auto& [name, board] : names) {
    ASSIGN_OR_RETURN(Json changes, BoardChanges(old, now, *from, *to, name));
    json["boards"].push_back(std::move(changes));
  }
  json["unreadable"] = DamagedToJson(now.damaged);
  return absl::OkStatus();
}

std::string RejudgeName(int64_t id) { return absl::StrCat("rejudge ", id); }

ApiResult ListRejudges(const ApiContext&, const Transaction& reader, const Request& request) {
  ASSIGN_OR_RETURN(const Page page, ReadPage(request));
  Listed<Json> listed;
  const auto& rejudges = reader.Board().rejudges();
  for (auto it = rejudges.rbegin(); it != rejudges.rend(); ++it) {
    if (it->first >= page.before || listed.found() == page.limit) continue;
    listed.last_id = it->first;
    const absl::StatusOr<RejudgeProgress> progress = reader.rejudges.CountProgress(it->second);
    if (IsLeftOut(progress.status())) continue;
    if (!progress.ok()) return progress.status();
    listed.rows.push_back(SummaryOf(it->second, *progress));
  }
  return PageAnswer(request, page, "rejudges", listed, [](const Json& row) { return row; });
}

ApiResult GetRejudge(const ApiContext&, const Transaction& reader, const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {"changes"}));
  ASSIGN_OR_RETURN(const bool changes, ReadSwitch(request, "changes", false));
  ASSIGN_OR_RETURN(const RejudgeRow row, reader.rejudges.Find(ReadId(request)));
  ApiAnswer answer;
  ASSIGN_OR_RETURN(answer.body, WholeRejudgeToJson(reader, row));
  if (changes) RETURN_IF_ERROR(AddRejudgeChanges(reader, row, answer.body));
  return answer;
}

// The rejudge as it is now, with `more` keys.
ApiResult ShowRejudge(const ApiContext& context, int64_t id, int http, Json more) {
  ASSIGN_OR_RETURN(Json body,
                   ReadStore(context, [&](const Transaction& reader) -> absl::StatusOr<Json> {
                     ASSIGN_OR_RETURN(const RejudgeRow row, reader.rejudges.Find(id));
                     return WholeRejudgeToJson(reader, row);
                   }));
  body.update(more);
  return ApiAnswer{http, std::move(body)};
}

ApiResult CreateRejudge(const ApiContext& context, const Request&, const Json& body) {
  ASSIGN_OR_RETURN(const RejudgeRequest asked, ParseRejudge(body));
  ASSIGN_OR_RETURN(const NewRejudge rejudge, ReadStore(context, [&](const Transaction& reader) {
    return MakeRejudge(reader, context, asked);
  }));
  ASSIGN_OR_RETURN(const SignDocument sign, RejudgeSigner(context));
  ASSIGN_OR_RETURN(
      const RejudgePlan plan,
      context.engine.CreateRejudge(rejudge, sign, CallerKey(), context.config.http.request));
  NoteAct(RejudgeName(plan.rejudge), "created");
  return ShowRejudge(context, plan.rejudge, 201, {{"plan", plan}});
}

// Has the daemon play and show the board's new config once an act is written.
AfterRejudge PlayFromNowOn(const ApiContext& context) {
  return [&context = context](const RejudgeDone& done) {
    if (done.config_after == done.config_before) return;
    const absl::Status switched = context.readers.Read([&](const Transaction& reader) {
      return SwitchConfig(reader, done.config_after, context.tracks, context.phases);
    });
    if (switched.ok()) return;
    spdlog::error(
        "rejudge {} is {} and its board's config is {}, but episodes are played under it only "
        "after a restart: {}",
        done.event.rejudge, EnumName(done.event.event), done.config_after,
        std::string(switched.message()));
  };
}

// Applies or drops a rejudge.
ApiResult ActOnRejudge(const ApiContext& context, const RejudgeAct& act, bool apply) {
  ASSIGN_OR_RETURN(const SignDocument sign, RejudgeSigner(context));
  ASSIGN_OR_RETURN(const RejudgeDone done,
                   context.engine.EndRejudge(apply, act, sign, CallerKey(),
                                             context.config.http.request, PlayFromNowOn(context)));
  NoteAct(RejudgeName(act.rejudge), apply ? "applied" : "dropped");
  Json more = {{"config_before", done.config_before}, {"config_after", done.config_after}};
  if (!apply) more["accepted_under_to_config"] = done.stay;
  return ShowRejudge(context, act.rejudge, 200, std::move(more));
}

ApiResult ApplyRejudge(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(RejudgeAct act, ParseApply(body));
  act.rejudge = ReadId(request);
  return ActOnRejudge(context, act, /*apply=*/true);
}

ApiResult DropRejudge(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(std::string reason, ParseReason(body));
  return ActOnRejudge(context, {.rejudge = ReadId(request), .why = std::move(reason)},
                      /*apply=*/false);
}

}  // namespace

void AddRejudges(Routes& routes, const ApiContext& context) {
  routes.Get("/v1/rejudges", Action::kRejudge, Bind(context, ListRejudges));
  routes.Post("/v1/rejudges", Action::kRejudge, Bind(context, CreateRejudge));
  routes.Get(R"(/v1/rejudges/(\d{1,18}))", Action::kRejudge, Bind(context, GetRejudge));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/apply)", Action::kRejudge, Bind(context, ApplyRejudge));
  routes.Post(R"(/v1/rejudges/(\d{1,18})/drop)", Action::kRejudge, Bind(context, DropRejudge));
}

}  // namespace myograde::server
