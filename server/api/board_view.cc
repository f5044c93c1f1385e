#include "server/api/board_view.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "scoring/aggregate_json.h"
#include "server/api/board_source.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

using scoring::Criterion;
using scoring::PlaceTest;
using Ranks = scoring::StatisticsConfig::Ranks;

constexpr char kSuccessRate[] = "success_rate";

// What a criterion is called in an aggregate; null: nothing but the acceptance decides.
Json NameOf(const Track& track, const Criterion& criterion) {
  if (criterion.kind == Criterion::Kind::kSuccess) return kSuccessRate;
  if (criterion.kind == Criterion::Kind::kAcceptance) return nullptr;
  return scoring::MetricOf(track.scoring.track->metrics, criterion.number).name;
}

// Which build each row is of, and which one the board itself is of.
void AddBuilds(const Transaction& reader, const Leaderboard& board, Json& json) {
  std::vector<int64_t> evaluations;
  for (const LeaderboardRow& row : board.rows) evaluations.push_back(row.source.evaluation);
  const BoardBuilds builds = CountBuilds(evaluations, reader.evaluations.ListGraders(evaluations));
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
void AddOtherConfigs(const Transaction& reader, const BoardQuery& asked, Json& json) {
  int64_t left = 0;
  json["other_configs"] = Json::array();
  for (const OtherConfig& other :
       reader.Board().OtherConfigs(asked.name(), asked.track->config.hash, asked.moment())) {
    left += other.left;
    json["other_configs"].push_back({{"config", other.config},
                                     {"submissions", other.submissions},
                                     {"teams", other.teams},
                                     {"from", TimeToJson(other.first_at)},
                                     {"to", TimeToJson(other.last_at)},
                                     {"in_force", other.config == asked.config_in_force}});
  }
  json["other_config"] = left;
}

// Adds "band" and "decided_by" of each row, and "bands", the words of each. A baseline has none.
void AddBands(const Track& track, const scoring::BoardRules& rules, const Leaderboard& board,
              Json& json) {
  const auto metrics = track.scoring.track->metrics;
  json["bands"] = Json::array();
  for (size_t i = 0; i < board.rows.size(); ++i) {
    const scoring::RankedEntry& ranked = board.rows[i].ranked;
    Json& row = json["rows"][i];
    row["band"] = row["decided_by"] = nullptr;
    if (ranked.rank == 0) continue;
    row["decided_by"] = NameOf(track, scoring::CriterionWithin(ranked, rules));
    const std::string words = scoring::DescribeBand(ranked, rules, metrics);
    if (words.empty()) continue;
    row["band"] = ranked.band + 1;
    if (json["bands"].empty() || json["bands"].back()["band"] != row["band"]) {
      json["bands"].push_back({{"band", row["band"]}, {"words", words}});
    }
  }
}

// Adds which board was asked for, and how much of it the caller sees. `withheld`: some was left
// out.
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

// --- statistics ---

Json DescriptionOf(const Track& track, const Criterion& criterion) {
  if (criterion.kind == Criterion::Kind::kNumber) {
    return MetricToJson(scoring::MetricOf(track.scoring.track->metrics, criterion.number));
  }
  return {{"name", kSuccessRate},
          {"title", "success"},
          {"unit", ""},
          {"better", "more"},
          {"digits", 3}};
}

// `other`: the row that it is compared with.
Json TestToJson(const Track& track, const std::optional<PlaceTest>& place,
                const LeaderboardRow& other) {
  if (!place.has_value()) return nullptr;
  const scoring::PairedTest& test = place->test;
  const bool exact = test.method == scoring::PairedTest::Method::kExact;
  return {{"team", other.source.team},
          {"submission", other.source.submission},
          {"metric", NameOf(track, place->criterion)},
          {"p", test.p},
          {"looks", place->looks},
          {"p_adjusted", place->p_adjusted},
          {"decided", place->decided},
          {"reversed", place->reversed},
          {"difference", test.difference},
          {"pairs", test.pairs},
          {"differing", test.differing},
          {"method", exact ? "exact" : "monte-carlo"}};
}

// Null where the aggregate has no such number.
Json IntervalToJson(const Json& aggregate, const std::string& name,
                    const std::optional<scoring::Spread>& over_steps) {
  const Json value = aggregate.value(name, Json());
  if (value.is_null()) return nullptr;
  if (over_steps.has_value()) {
    return {{"value", value},
            {"low", over_steps->low},
            {"high", over_steps->high},
            {"method", "ratio"}};
  }
  const Json spread = aggregate.value("spread", Json::object()).value(name, Json());
  if (!spread.is_object()) return nullptr;
  return {{"value", value},
          {"low", spread.value("low", Json())},
          {"high", spread.value("high", Json())},
          {"method", name == kSuccessRate ? "wilson" : "normal"}};
}

Json ListIntervals(const Track& track, const scoring::BoardRules& rules, const Json& aggregate,
                   const TestedPlace* tested) {
  Json intervals = Json::object();
  const std::vector<Criterion> criteria = scoring::ListCriteria(rules);
  for (size_t i = 0; i < criteria.size(); ++i) {
    const std::string name = NameOf(track, criteria[i]).get<std::string>();
    intervals[name] = IntervalToJson(aggregate, name,
                                     tested == nullptr ? std::nullopt : tested->over_steps.at(i));
  }
  return intervals;
}

// What a row has whether it was tested or not.
Json PlainRow(const LeaderboardRow& row, int64_t rank, const EpisodeCounts& counts) {
  Json json = RowToJson(row);
  for (const char* key : {"rejudge", "qualified", "aggregate"}) json.erase(key);
  json.update({{"rank", IdOrNull(rank)},
               {"episodes", counts.done},
               {"participant_faults", counts.fault},
               {"group", nullptr},
               {"further_episodes", 0},
               {"above", nullptr},
               {"opener", nullptr}});
  return json;
}

void AddTests(const Track& track, const Leaderboard& board, const std::vector<TestedPlace>& places,
              size_t own, Json& json) {
  const TestedPlace& tested = places[own];
  const auto row_of = [&](size_t place) -> const LeaderboardRow& {
    return board.rows[places[place].row];
  };
  json["group"] = tested.place.group;
  json["further_episodes"] = tested.further;
  if (own == 0) return;
  json["above"] = TestToJson(track, tested.place.above, row_of(own - 1));
  json["opener"] = TestToJson(track, tested.place.opener, row_of(tested.place.opened_by));
}

// Each group with the first and the last of its ranks by the rules.
Json GroupsOf(const Leaderboard& board, const BoardStatistics& statistics) {
  Json groups = Json::array();
  for (const TestedPlace& tested : statistics.places) {
    const int64_t rank = board.rows[tested.row].ranked.rank;
    if (groups.empty() || groups.back()["group"] != tested.place.group) {
      groups.push_back(
          {{"group", tested.place.group}, {"first", rank}, {"last", rank}, {"rows", 0}});
    }
    groups.back()["last"] = rank;
    groups.back()["rows"] = groups.back()["rows"].get<int64_t>() + 1;
  }
  return groups;
}

// "statistics", "criteria", "rows", "groups" and "undecided" of the answer.
Json StatisticsAnswer(const Transaction& reader, const Track& track,
                      const scoring::BoardRules& rules, const Leaderboard& board,
                      const BoardStatistics& statistics, const scoring::StatisticsConfig& config) {
  std::map<size_t, size_t> place_of;  // among the tested, by row
  for (size_t i = 0; i < statistics.places.size(); ++i) place_of[statistics.places[i].row] = i;
  const BoardStatistics untested;
  const std::vector<int64_t> ranks =
      PublishedRanks(board, config.ranks == Ranks::kGroups ? statistics : untested);
  Json rows = Json::array();
  for (size_t i = 0; i < board.rows.size(); ++i) {
    const LeaderboardRow& row = board.rows[i];
    Json json = PlainRow(row, ranks[i], reader.episodes.Counts(row.source.evaluation));
    const auto found = place_of.find(i);
    const TestedPlace* tested =
        found == place_of.end() ? nullptr : &statistics.places[found->second];
    if (tested != nullptr) AddTests(track, board, statistics.places, found->second, json);
    json["intervals"] = ListIntervals(track, rules, row.source.aggregate, tested);
    rows.push_back(std::move(json));
  }
  Json used = scoring::StatisticsToJson(config);
  used["correction"] = "holm";
  used["spending"] = config.groups.further_looks ? Json("halving") : Json();
  used["tests"] = statistics.tests;
  Json criteria = Json::array();
  for (const Criterion& criterion : scoring::ListCriteria(rules)) {
    criteria.push_back(DescriptionOf(track, criterion));
  }
  Json groups = GroupsOf(board, statistics);
  int64_t undecided = 0;
  for (const Json& group : groups) {
    const auto in_group = group["rows"].get<int64_t>();
    if (in_group > 1) undecided += in_group;
  }
  return {{"statistics", std::move(used)},
          {"criteria", std::move(criteria)},
          {"rows", std::move(rows)},
          {"groups", std::move(groups)},
          {"undecided", undecided}};
}

}  // namespace

BoardBuilds CountBuilds(const std::vector<int64_t>& evaluations,
                        const std::vector<std::string>& graders) {
  BoardBuilds builds;
  std::map<std::string, std::string> known;  // boards have many rows of few builds
  std::map<std::string, std::pair<size_t, int64_t>> found;
  for (size_t i = 0; i < graders.size(); ++i) {
    auto it = known.find(graders[i]);
    if (it == known.end()) it = known.emplace(graders[i], SimulatingBuild(graders[i])).first;
    auto& [rows, newest] = found[it->second];
    ++rows;
    newest = std::max(newest, evaluations[i]);
    builds.of_rows.push_back(it->second);
  }
  for (const auto& [build, count] : found) builds.counts.push_back({build, count.first});
  std::sort(builds.counts.begin(), builds.counts.end(),
            [&](const auto& a, const auto& b) { return found[a.build] > found[b.build]; });
  return builds;
}

Json ColumnsToJson(const scoring::ScoredTrack& track, const scoring::BoardSpec& board) {
  Json columns = Json::array();
  for (const size_t place : board.columns) columns.push_back(MetricToJson(track.metrics[place]));
  return columns;
}

absl::StatusOr<Json> BoardView(const Transaction& reader, const BoardQuery& asked,
                               const scoring::StatisticsConfig& statistics, KeptStatistics& kept) {
  const TrackConfig& config = asked.track->config;
  ASSIGN_OR_RETURN(BoardSource source, SourceOf(reader, *asked.track, asked.moment()));
  ASSIGN_OR_RETURN(const Leaderboard board, BoardOf(source, *asked.track, asked.rules->rules));
  Json json = BoardToJson(board);
  if (statistics.ranks == scoring::StatisticsConfig::Ranks::kGroups) {
    ASSIGN_OR_RETURN(const auto tested, kept.Of(reader, asked, board, statistics.groups));
    source.damaged.insert(source.damaged.end(), tested->damaged.begin(), tested->damaged.end());
    const std::vector<int64_t> ranks = PublishedRanks(board, *tested);
    for (size_t i = 0; i < ranks.size(); ++i) {
      if (ranks[i] != 0) json["rows"][i]["rank"] = ranks[i];
    }
  }
  json["ranks"] = scoring::StatisticsToJson(statistics)["ranks"];
  AddBuilds(reader, board, json);
  AddOtherConfigs(reader, asked, json);
  json["unreadable"] = DamagedToJson(source.damaged);
  AddBoardAsked(asked, source.withheld, json);
  // Boards by a mean score have no settings.
  json["rules"] =
      config.scoring.value("boards", Json::object()).value(asked.board, Json::object());
  json["official_figures"] = asked.track->scoring.official_figures;
  json["columns"] = ColumnsToJson(*asked.track->scoring.track, *asked.rules);
  json["order"] = scoring::DescribeOrder(asked.rules->rules);
  AddBands(*asked.track, asked.rules->rules, board, json);
  return json;
}

absl::StatusOr<Json> StatisticsView(const Transaction& reader, const BoardQuery& asked,
                                    const scoring::StatisticsConfig& config, KeptStatistics& kept) {
  const Track& track = *asked.track;
  const scoring::BoardRules& rules = asked.rules->rules;
  ASSIGN_OR_RETURN(BoardSource source, SourceOf(reader, track, asked.moment()));
  ASSIGN_OR_RETURN(const Leaderboard board, BoardOf(source, track, rules));
  ASSIGN_OR_RETURN(const auto statistics, kept.Of(reader, asked, board, config.groups));
  Json json = StatisticsAnswer(reader, track, rules, board, *statistics, config);
  AddBoardAsked(asked, source.withheld, json);
  source.damaged.insert(source.damaged.end(), statistics->damaged.begin(),
                        statistics->damaged.end());
  json["unreadable"] = DamagedToJson(source.damaged);
  return json;
}

}  // namespace myograde::server
