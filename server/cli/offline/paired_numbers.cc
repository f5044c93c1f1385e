#include "server/cli/offline/paired_numbers.h"

#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "scoring/groups.h"
#include "scoring/paired_test.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;
using RowPairs = std::vector<std::pair<const Json*, const Json*>>;

// What says that two episodes were drawn alike: the seed, or where it is hidden its commitment.
std::string SeedKey(const Json& row) {
  for (const char* key : {"seed_commitment", "seed"}) {
    const Json value = row.value(key, Json());
    if (!value.is_null()) return absl::StrCat(key, " ", value.dump());
  }
  return "";
}

// Such a trial was not played, so it says nothing of its seed.
bool IsPhantom(const Json& row) { return row.value("end", Json()) == Json(kPhantom); }

RowPairs SameSeeds(const Json& a, const Json& b) {
  std::map<int64_t, const Json*> of_a;
  for (const Json& row : a["episode_rows"]) {
    if (!IsPhantom(row)) of_a[row.value("index", int64_t{-1})] = &row;
  }
  RowPairs pairs;
  for (const Json& row : b["episode_rows"]) {
    const auto found = of_a.find(row.value("index", int64_t{-1}));
    if (found == of_a.end() || IsPhantom(row)) continue;
    const std::string key = SeedKey(row);
    if (!key.empty() && key == SeedKey(*found->second)) pairs.emplace_back(found->second, &row);
  }
  return pairs;
}

std::optional<double> MetricOf(const Json& row, const std::string& name) {
  const Json metrics = row.value("metrics", Json());
  if (!metrics.is_object() || !metrics.value(name, Json()).is_number()) return std::nullopt;
  const double value = metrics[name].get<double>();
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

// Null where fewer than two episodes of both have the metric.
Json PairedMetric(const RowPairs& rows, Json metric) {
  std::vector<scoring::Pair> pairs;
  Json differences = Json::array();
  for (const auto& [a, b] : rows) {
    const std::optional<double> of_a = MetricOf(*a, metric["name"]);
    const std::optional<double> of_b = MetricOf(*b, metric["name"]);
    if (!of_a.has_value() || !of_b.has_value()) continue;
    pairs.push_back({{*of_a, 1}, {*of_b, 1}});
    differences.push_back(*of_a - *of_b);
  }
  const auto interval = scoring::IntervalOfDifference(pairs);
  if (!interval.has_value()) return nullptr;
  const scoring::PairedTest test = scoring::TestPairs(pairs, scoring::GroupRules().samples);
  const bool exact = test.method == scoring::PairedTest::Method::kExact;
  metric.update({{"differences", std::move(differences)},
                 {"difference", test.difference},
                 {"low", interval->low},
                 {"high", interval->high},
                 {"p", test.p},
                 {"pairs", test.pairs},
                 {"differing", test.differing},
                 {"method", exact ? "exact" : "monte-carlo"}});
  return metric;
}

std::string Of(const Json& result) {
  return absl::StrCat("submission ", result.value("submission", int64_t{0}));
}

}  // namespace

absl::StatusOr<Json> PairedNumbers(const Json& a, const Json& b) {
  const RowPairs rows = SameSeeds(a, b);
  if (rows.empty() || a.value("track_kind", Json()) != b.value("track_kind", Json())) {
    return absl::FailedPreconditionError(
        absl::StrCat(Of(a), " and ", Of(b), " have no episode on the same seed of one track, so "
                     "there is nothing to compare"));
  }
  Json metrics = Json::array();
  const Json success = {{"name", "success"}, {"title", "success"}, {"unit", ""},
                        {"better", "more"},  {"digits", 3}};
  std::vector<Json> wanted = {success};
  for (const Json& metric : a.value("metrics", Json::array())) {
    if (metric.value("name", "") != "success") wanted.push_back(metric);
  }
  for (Json& metric : wanted) {
    Json compared = PairedMetric(rows, std::move(metric));
    if (!compared.is_null()) metrics.push_back(std::move(compared));
  }
  if (!metrics.empty()) return Json{{"pairs", rows.size()}, {"metrics", std::move(metrics)}};
  return absl::FailedPreconditionError(
      absl::StrCat("fewer than two episodes of ", Of(a), " and ", Of(b),
                   " have numbers that both show: their phase withholds them, or they have not "
                   "been played yet"));
}

}  // namespace myograde::server
