#include "server/api/rejudge_view.h"

#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "scoring/track.h"
#include "server/api/board_source.h"
#include "server/api/rejudge_plan.h"
#include "server/api/views.h"
#include "server/engine/stored.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json SummaryOf(const RejudgeRow& rejudge, const RejudgeProgress& progress) {
  return {{"rejudge", rejudge.id},
          {"at", TimeToJson(rejudge.at)},
          {"purpose", RejudgePurposeName(rejudge.purpose)},
          {"state", RejudgeStateName(progress.state)},
          {"complete", progress.complete},
          {"phase", TextOrNull(rejudge.phase)},
          {"track", rejudge.track},
          {"profile", rejudge.profile},
          {"from_config", rejudge.from_config},
          {"to_config", rejudge.to_config},
          {"method", RejudgeMethodName(rejudge.method)},
          {"repeats", rejudge.repeats},
          {"who", rejudge.who},
          {"reason", rejudge.why},
          {"submissions", progress.submissions},
          {"items",
           {{"total", progress.items + progress.missing},
            {"ended", progress.ended},
            {"facts", progress.facts},
            {"play", progress.play}}},
          {"episodes", {{"total", progress.episodes}, {"done", progress.episodes_done}}}};
}

Json EventToJson(const RejudgeEventRow& event) {
  return {{"event", RejudgeEventName(event.event)},
          {"at", TimeToJson(event.at)},
          {"who", event.who},
          {"reason", event.why},
          {"document", Json::parse(event.document_json, nullptr, false)},
          {"signature", event.signature}};
}

// Today's name of a submission's team; null if it can't be read.
Json TeamToJson(Reader& reader, int64_t submission) {
  const absl::StatusOr<std::string> team = reader.TeamOfSubmission(submission);
  return team.ok() ? Json(*team) : Json();
}

absl::StatusOr<Json> WithoutResultToJson(Reader& reader, const RejudgeRow& rejudge,
                                         const RejudgeProgress& progress) {
  Json without = Json::array();
  if (progress.without_result.empty()) return without;
  ASSIGN_OR_RETURN(const std::vector<RejudgeItemRow> items, reader.RejudgeItems(rejudge.id));
  std::map<int64_t, const RejudgeItemRow*> first;
  for (const RejudgeItemRow& item : items) first.try_emplace(item.submission, &item);
  for (const int64_t submission : progress.without_result) {
    const RejudgeItemRow& item = *first.at(submission);
    without.push_back({{"submission", submission},
                       {"team", TeamToJson(reader, submission)},
                       {"evaluation", item.evaluation},
                       {"state", EvaluationStateName(item.state)},
                       {"reason", TextOrNull(item.reason)}});
  }
  return without;
}

Json RejudgedRow(const LeaderboardRow& row) {
  const bool baseline = row.ranked.rank == 0;
  return {{"rank", baseline ? Json() : Json(row.ranked.rank)},
          {"baseline", baseline},
          {"submission", row.source.submission},
          {"evaluation", row.source.evaluation},
          {"name", row.source.artefact_name},
          {"qualified", row.qualified},
          {"aggregate", row.aggregate}};
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
    rows.push_back(
        {{"team", row.source.team}, {"before", RejudgedRow(row)}, {"after", nullptr}});
  }
  return rows;
}

// Before and after the moment of its application, or of now.
struct RejudgeMoments {
  BoardMoment before;
  BoardMoment after;
};

absl::StatusOr<RejudgeMoments> MomentsOf(Reader& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const std::vector<RejudgeEventRow> events, reader.RejudgeEvents(rejudge.id));
  RejudgeMoments moments;
  moments.after.assumed_rejudge = rejudge.id;
  if (!events.empty() && events.back().event == RejudgeEvent::kApplied) {
    moments.before.before_ms = events.back().at;
    moments.after.before_ms = events.back().at + 1;
  }
  return moments;
}

absl::StatusOr<Leaderboard> BoardOrEmpty(Reader& reader, const Track& track,
                                         const std::string& name, const BoardMoment& moment) {
  if (!track.scoring.boards.contains(name)) return Leaderboard();
  return BoardUnder(reader, track, name, moment);
}

absl::StatusOr<Json> BoardChanges(Reader& reader, const Track& from, const Track& to,
                                  const std::string& name, const RejudgeMoments& moments,
                                  std::vector<Damage>& damaged) {
  const absl::StatusOr<Leaderboard> before = BoardOrEmpty(reader, from, name, moments.before);
  if (!before.ok()) return before.status();
  const absl::StatusOr<Leaderboard> after = BoardOrEmpty(reader, to, name, moments.after);
  if (!after.ok()) return after.status();
  damaged.insert(damaged.end(), after->damaged.begin(), after->damaged.end());
  int64_t moved = 0;
  Json rows = CompareBoards(*before, *after, moved);
  const bool stays = to.scoring.boards.contains(name);
  const Track& shown = stays ? to : from;
  const scoring::BoardSpec& board = shown.scoring.boards.at(name);
  Json columns = Json::array();
  for (const size_t place : board.columns) {
    columns.push_back(MetricToJson(shown.scoring.track->metrics[place]));
  }
  return Json{{"board", name},
              {"order", stays ? Json(scoring::DescribeOrder(board.rules)) : Json()},
              {"columns", std::move(columns)},
              {"moved", moved},
              {"rows", std::move(rows)}};
}

absl::StatusOr<Json> NotRepeatableToJson(Reader& reader, int64_t rejudge) {
  ASSIGN_OR_RETURN(const std::vector<Unrepeatable> found, reader.UnrepeatableOf(rejudge));
  Json list = Json::array();
  for (const Unrepeatable& one : found) {
    Json episodes = Json::array();
    for (const Unrepeatable::Episode& episode : one.episodes) {
      episodes.push_back({{"index", episode.index},
                          {"repetition", episode.repetition},
                          {"differs", episode.differs}});
    }
    list.push_back({{"submission", one.submission},
                    {"team", TeamToJson(reader, one.submission)},
                    {"episodes", std::move(episodes)}});
  }
  return list;
}

}  // namespace

absl::StatusOr<Json> RejudgeToJson(Reader& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const RejudgeProgress progress, reader.ProgressOf(rejudge));
  return SummaryOf(rejudge, progress);
}

absl::StatusOr<Json> WholeRejudgeToJson(Reader& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const RejudgeProgress progress, reader.ProgressOf(rejudge));
  ASSIGN_OR_RETURN(Json without, WithoutResultToJson(reader, rejudge, progress));
  Json json = SummaryOf(rejudge, progress);
  json["without_result"] = std::move(without);
  ASSIGN_OR_RETURN(const std::vector<RejudgeEventRow> events, reader.RejudgeEvents(rejudge.id));
  json["events"] = Json::array();
  for (const RejudgeEventRow& event : events) json["events"].push_back(EventToJson(event));
  ASSIGN_OR_RETURN(const std::string from, reader.ConfigJson(rejudge.from_config));
  ASSIGN_OR_RETURN(const std::string to, reader.ConfigJson(rejudge.to_config));
  json["differs"] = DifferingKeys(Json::parse(from), Json::parse(to));
  return json;
}

absl::Status AddRejudgeChanges(Reader& reader, const RejudgeRow& rejudge, Json& json) {
  json["boards"] = Json::array();
  ASSIGN_OR_RETURN(Json unlike, NotRepeatableToJson(reader, rejudge.id));
  json["not_repeatable"] = std::move(unlike);
  std::vector<Damage> damaged;
  if (rejudge.purpose == RejudgePurpose::kRules) {
    ASSIGN_OR_RETURN(const TrackPtr from, StoredTrack(reader, rejudge.from_config));
    ASSIGN_OR_RETURN(const TrackPtr to, StoredTrack(reader, rejudge.to_config));
    ASSIGN_OR_RETURN(const RejudgeMoments moments, MomentsOf(reader, rejudge));
    auto names = from->scoring.boards;
    names.insert(to->scoring.boards.begin(), to->scoring.boards.end());
    for (const auto& [name, board] : names) {
      ASSIGN_OR_RETURN(Json changes, BoardChanges(reader, *from, *to, name, moments, damaged));
      json["boards"].push_back(std::move(changes));
    }
  }
  json["unreadable"] = DamagedToJson(damaged);
  return absl::OkStatus();
}

}  // namespace myograde::server
