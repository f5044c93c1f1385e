#include "server/api/statistics_view.h"

#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "server/grading/results.h"

namespace myograde::server {
namespace {

using scoring::Criterion;
using scoring::PlaceTest;
using Json = nlohmann::json;
using Ranks = scoring::StatisticsConfig::Ranks;

constexpr char kSuccessRate[] = "success_rate";

// What a criterion is called in an aggregate; null: nothing but the acceptance decides.
Json NameOf(const Track& track, const Criterion& criterion) {
  switch (criterion.kind) {
    case Criterion::Kind::kSuccess:
      return kSuccessRate;
    case Criterion::Kind::kNumber:
      return scoring::MetricOf(track.scoring.track->metrics, criterion.number).name;
    case Criterion::Kind::kAcceptance:
      break;
  }
  return nullptr;
}

Json DescriptionOf(const Track& track, const Criterion& criterion) {
  if (criterion.kind == Criterion::Kind::kNumber) {
    return MetricToJson(scoring::MetricOf(track.scoring.track->metrics, criterion.number));
  }
  return {{"name", kSuccessRate}, {"title", "success"}, {"unit", ""}, {"better", "more"},
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
    return {{"value", value}, {"low", over_steps->low}, {"high", over_steps->high},
            {"method", "ratio"}};
  }
  const Json spread = aggregate.value("spread", Json::object()).value(name, Json());
  if (!spread.is_object()) return nullptr;
  return {{"value", value},
          {"low", spread.value("low", Json())},
          {"high", spread.value("high", Json())},
          {"method", name == kSuccessRate ? "wilson" : "normal"}};
}

Json IntervalsOf(const Track& track, const scoring::BoardRules& rules, const Json& aggregate,
                 const TestedPlace* tested) {
  Json intervals = Json::object();
  const std::vector<Criterion> criteria = scoring::CriteriaOf(rules);
  for (size_t i = 0; i < criteria.size(); ++i) {
    const std::string name = NameOf(track, criteria[i]).get<std::string>();
    intervals[name] = IntervalToJson(aggregate, name,
                                     tested == nullptr ? std::nullopt : tested->over_steps.at(i));
  }
  return intervals;
}

// What a row has whether it was tested or not.
Json PlainRow(const LeaderboardRow& row, int64_t rank, const EpisodeCounts& counts) {
  const bool baseline = row.ranked.rank == 0;
  return {{"rank", baseline ? Json() : Json(rank)},
          {"rank_by_rules", baseline ? Json() : Json(row.ranked.rank)},
          {"baseline", baseline},
          {"team", row.source.team},
          {"submission", row.source.submission},
          {"evaluation", row.source.evaluation},
          {"name", row.source.artefact_name},
          {"episodes", counts.done},
          {"participant_faults", counts.fault},
          {"group", nullptr},
          {"further_episodes", 0},
          {"above", nullptr},
          {"opener", nullptr}};
}

void AddTests(const Track& track, const Leaderboard& board,
              const std::vector<TestedPlace>& places, size_t own, Json& json) {
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
      groups.push_back({{"group", tested.place.group}, {"first", rank}, {"last", rank}, {"rows", 0}});
    }
    groups.back()["last"] = rank;
    groups.back()["rows"] = groups.back()["rows"].get<int64_t>() + 1;
  }
  return groups;
}

int64_t UndecidedRows(const Json& groups) {
  int64_t undecided = 0;
  for (const Json& group : groups) {
    const auto rows = group["rows"].get<int64_t>();
    if (rows > 1) undecided += rows;
  }
  return undecided;
}

}  // namespace

absl::StatusOr<Json> StatisticsAnswer(Reader& reader, const Track& track,
                                      const scoring::BoardRules& rules, const Leaderboard& board,
                                      const BoardStatistics& statistics,
                                      const scoring::StatisticsConfig& config) {
  std::map<size_t, size_t> place_of;  // among the tested, by row
  for (size_t i = 0; i < statistics.places.size(); ++i) place_of[statistics.places[i].row] = i;
  const BoardStatistics untested;
  const std::vector<int64_t> ranks =
      PublishedRanks(board, config.ranks == Ranks::kGroups ? statistics : untested);
  Json rows = Json::array();
  for (size_t i = 0; i < board.rows.size(); ++i) {
    const LeaderboardRow& row = board.rows[i];
    Json json = PlainRow(row, ranks[i], reader.Counts(row.source.evaluation));
    const auto found = place_of.find(i);
    const TestedPlace* tested =
        found == place_of.end() ? nullptr : &statistics.places[found->second];
    if (tested != nullptr) AddTests(track, board, statistics.places, found->second, json);
    json["intervals"] = IntervalsOf(track, rules, row.aggregate, tested);
    rows.push_back(std::move(json));
  }
  Json used = scoring::StatisticsToJson(config);
  used["correction"] = "holm";
  used["spending"] = config.groups.further_looks ? Json("halving") : Json();
  used["tests"] = statistics.tests;
  Json criteria = Json::array();
  for (const Criterion& criterion : scoring::CriteriaOf(rules)) {
    criteria.push_back(DescriptionOf(track, criterion));
  }
  Json groups = GroupsOf(board, statistics);
  const int64_t undecided = UndecidedRows(groups);
  return Json{{"statistics", std::move(used)},
              {"criteria", std::move(criteria)},
              {"rows", std::move(rows)},
              {"groups", std::move(groups)},
              {"undecided", undecided}};
}

}  // namespace myograde::server
