// myograde plot
#include <absl/strings/str_cat.h>

#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/status_macros.h"
#include "scoring/groups.h"
#include "scoring/paired_test.h"
#include "server/base/counted.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/offline/draw.h"
#include "server/cli/offline/figure_sources.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/offline/verbs.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {
namespace {

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

// The episodes that results `a` and `b` (of the API, with rows) both played with the same seed, by
// metric: {"pairs": N, "metrics": [{"name", "title", "unit", "better", "digits", "differences",
// "difference", "low", "high", "p", "pairs", "differing", "method"}]}. Differences are a less b.
// Interval and p-value are those of scoring/paired_test.h, not corrected for several tests.
// FailedPreconditionError if no episode can be compared.
absl::StatusOr<Json> PairedNumbers(const Json& a, const Json& b) {
  const RowPairs rows = SameSeeds(a, b);
  if (rows.empty() || a.value("track_kind", Json()) != b.value("track_kind", Json())) {
    return absl::FailedPreconditionError(
        absl::StrCat(Of(a), " and ", Of(b),
                     " have no episode on the same seed of one track, so "
                     "there is nothing to compare"));
  }
  Json metrics = Json::array();
  const Json success = {
      {"name", "success"}, {"title", "success"}, {"unit", ""}, {"better", "more"}, {"digits", 3}};
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

struct PlotKind {
  const char* name;
  size_t least;  // submissions that it shows; 0: it is of a board
  size_t most;
};

constexpr PlotKind kPlotKinds[] = {{"board", 0, 0},    {"distributions", 1, 1}, {"courses", 1, 8},
                                   {"survival", 1, 8}, {"joints", 1, 4},        {"paired", 2, 2}};

struct PlotOptions : DaemonOptions {
  std::string kind;
  std::vector<int64_t> ids;
  BoardChoice board;
  std::string file;
};

const PlotKind& KindOf(const PlotOptions& options) {
  for (const PlotKind& kind : kPlotKinds) {
    if (options.kind == kind.name) return kind;
  }
  return kPlotKinds[0];  // CLI11 has checked it
}

absl::Status CheckPlot(const PlotOptions& options) {
  const PlotKind& kind = KindOf(options);
  const std::set<int64_t> different(options.ids.begin(), options.ids.end());
  if (options.ids.size() < kind.least || options.ids.size() > kind.most) {
    const std::string range = kind.least == kind.most ? "" : absl::StrCat(kind.least, " to ");
    return absl::InvalidArgumentError(
        kind.most == 0 ? "plot board shows a board, no submission: give --track or --phase instead"
                       : absl::StrCat("plot ", kind.name, " shows ", range,
                                      Counted(static_cast<int64_t>(kind.most), "submission"),
                                      ": give as many numbers"));
  }
  if (different.size() != options.ids.size()) {
    return absl::InvalidArgumentError("a submission is named twice; give each number once");
  }
  if (kind.most == 0 && !options.board.named()) {
    return absl::InvalidArgumentError("plot board shows one board: give --track or --phase");
  }
  if (kind.most > 0 && options.board.named()) {
    return absl::InvalidArgumentError(
        absl::StrCat("plot ", kind.name, " shows submissions: leave out --track, --phase and "
                     "--config"));
  }
  if (options.file.empty() && !options.json) {
    return absl::InvalidArgumentError(
        "say with -o which file to write, or with --json that you want the numbers");
  }
  return absl::OkStatus();
}

absl::Status Gather(const PlotOptions& options, Json& order) {
  const Client client = options.client();
  if (KindOf(options).most == 0) return AddBoard(client, options.board, order);
  order["results"] = Json::array();
  for (const int64_t id : options.ids) {
    ASSIGN_OR_RETURN(Json result, ResultForFigures(client, id));
    order["results"].push_back(std::move(result));
  }
  if (options.kind != "paired") return absl::OkStatus();
  ASSIGN_OR_RETURN(order["paired"], PairedNumbers(order["results"][0], order["results"][1]));
  return absl::OkStatus();
}

absl::StatusOr<int> Plot(const PlotOptions& options) {
  RETURN_IF_ERROR(CheckPlot(options));
  Json order = {{"make", "plot"}, {"kind", options.kind}, {"format", nullptr}};
  if (!options.file.empty()) {
    ASSIGN_OR_RETURN(order["format"], FormatOf(options.file, {"svg", "pdf"}));
  }
  CatchStopSignals();
  const absl::Status gathered = Gather(options, order);
  return DrawInto(options.file, gathered, order,
                  {{"kind", options.kind}, {"format", order["format"]}}, options.json);
}

}  // namespace

Action AddPlot(CLI::App& verb) {
  auto options = std::make_shared<PlotOptions>();
  std::vector<std::string> kinds;
  for (const PlotKind& kind : kPlotKinds) kinds.emplace_back(kind.name);
  verb.add_option("KIND", options->kind,
                  "board (over time), distributions, courses (results per kind of course), "
                  "survival (how long episodes went on), joints (angles against limits), paired "
                  "(differences on the same seeds)")
      ->required()
      ->check(CLI::IsMember(kinds));
  verb.add_option("ID", options->ids, "The submissions to show")
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "no submission's number, as \"myograde status\" lists them"));
  AddBoardChoice(verb, options->board, "The board of this track", "The board of this phase");
  verb.add_option("-o,--output", options->file, "The file to write: FILE.svg or FILE.pdf");
  AddDaemonOptions(verb, "plot", *options, "Print the numbers behind the figure as JSON");
  return [options] { return Plot(*options); };
}

}  // namespace myograde::server
