// What is drawn: myograde plot, report
#include <absl/strings/escaping.h>
#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "scoring/episode_order.h"
#include "scoring/groups.h"
#include "scoring/paired_test.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/offline/draw.h"

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
bool IsPhantom(const Json& row) { return row.value("end", Json()) == Json(scoring::kPhantom); }

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

std::optional<double> FindMetric(const Json& row, const std::string& name) {
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
    const std::optional<double> of_a = FindMetric(*a, metric["name"]);
    const std::optional<double> of_b = FindMetric(*b, metric["name"]);
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

// The episodes that results `a` and `b` (of the API, with rows) both played with the same seed, by
// metric: {"pairs": N, "metrics": [{"name", "title", "unit", "better", "digits", "differences",
// "difference", "low", "high", "p", "pairs", "differing", "method"}]}. Differences are a less b.
// Interval and p-value are those of scoring/paired_test.h, not corrected for several tests.
// FailedPreconditionError if no episode can be compared.
absl::StatusOr<Json> PairedNumbers(const Json& a, const Json& b) {
  const std::string both = Filled(a, "submission {submission} and ") +
                           Filled(b, "submission {submission}");
  const RowPairs rows = SameSeeds(a, b);
  if (rows.empty() || a.value("track_kind", Json()) != b.value("track_kind", Json())) {
    return absl::FailedPreconditionError(
        both + " have no episodes on the same seeds of one track, so there is nothing to compare");
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
      absl::StrCat("fewer than two episodes of ", both,
                   " have numbers for both: their phase withholds them, or they have not been "
                   "played yet"));
}

struct PlotKind {
  const char* name;
  size_t least;  // submissions that it shows; 0: it is of a board
  size_t most;
};

constexpr PlotKind kPlotKinds[] = {{"board", 0, 0},    {"distributions", 1, 1}, {"courses", 1, 8},
                                   {"survival", 1, 8}, {"joints", 1, 4},        {"paired", 2, 2}};

// Of both verbs.
struct FigureOptions : SubmissionOptions {
  BoardChoice board;
  std::string file;  // "": the numbers are wanted alone
};

// The format that the file's name asks for, "svg" of FIGURE.svg; null without a file.
absl::StatusOr<Json> ChooseFormat(const FigureOptions& options,
                                  const std::vector<std::string>& formats) {
  RETURN_IF_ERROR(
      RefuseIf({{options.file.empty() && !options.json,
                 "give -o with the file to write, or --json for the numbers"}}));
  if (options.file.empty()) return Json();
  for (const std::string& format : formats) {
    if (absl::EndsWithIgnoreCase(options.file, "." + format)) return Json(format);
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "-o ", options.file, ": name a file that ends in .", absl::StrJoin(formats, " or .")));
}

struct PlotOptions : FigureOptions {
  std::string kind;
  std::vector<int64_t> ids;
};

const PlotKind& FindKind(const PlotOptions& options) {
  for (const PlotKind& kind : kPlotKinds) {
    if (options.kind == kind.name) return kind;
  }
  return kPlotKinds[0];  // CLI11 has checked it
}

absl::Status CheckPlot(const PlotOptions& options) {
  const PlotKind& kind = FindKind(options);
  const std::set<int64_t> different(options.ids.begin(), options.ids.end());
  if (options.ids.size() < kind.least || options.ids.size() > kind.most) {
    const std::string range = kind.least == kind.most ? "" : absl::StrCat(kind.least, " to ");
    return absl::InvalidArgumentError(
        kind.most == 0 ? "plot board shows a board, not submissions: give --track or --phase "
                         "instead"
                       : absl::StrCat("plot ", kind.name, " shows ", range,
                                      Counted(static_cast<int64_t>(kind.most), "submission"),
                                      ": give that many numbers"));
  }
  return RefuseIf(
      {{different.size() != options.ids.size(),
        "a submission is named twice; give each number once"},
       {kind.most == 0 && !options.board.named(),
        "plot board shows one board: give --track or --phase"},
       {kind.most > 0 && options.board.named(),
        absl::StrCat("plot ", kind.name,
                     " shows submissions: leave out --track, --phase and --config")}});
}

absl::Status Gather(const PlotOptions& options, Json& order) {
  const Client client = options.client();
  if (FindKind(options).most == 0) return AddBoard(client, options.board, order);
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
  Json order = {{"make", "plot"}, {"kind", options.kind}};
  ASSIGN_OR_RETURN(order["format"], ChooseFormat(options, {"svg", "pdf"}));
  CatchStopSignals();
  if (!order["format"].is_null()) RETURN_IF_ERROR(CheckDrawing());
  const absl::Status gathered = Gather(options, order);
  return DrawInto(options.file, gathered, order,
                  {{"kind", options.kind}, {"format", order["format"]}}, options.json);
}

constexpr size_t kMostStripBytes = size_t{32} << 20;

struct ReportOptions : FigureOptions {
  bool no_pictures = false;
};

Json WhyNot(absl::string_view reason) { return {{"error", std::string(reason)}}; }

// What "myograde episode render" draws of the submission, as Base64, or why there is nothing.
// CancelledError after a stop signal.
absl::StatusOr<Json> PicturesOf(const ReportOptions& options) {
  const absl::StatusOr<TempFolder> temp = TempFolder::Make("strip");
  if (!temp.ok()) return WhyNot(temp.status().message());
  const std::string file = temp->path() + "/strip.png";
  std::vector<std::string> words = {absl::StrCat(options.id), "--strip", "-o", file};
  const std::pair<const char*, std::string> places[] = {{"--data", options.data},
                                                        {"--socket", options.socket},
                                                        {"--server", options.server},
                                                        {"--ca-file", options.ca_file}};
  for (const auto& [option, value] : places) {
    if (!value.empty()) words.insert(words.end(), {option, value});
  }
  const absl::Status drawn = RunRender(std::move(words));
  if (absl::IsCancelled(drawn)) return drawn;
  if (!drawn.ok()) return WhyNot(drawn.message());
  const absl::StatusOr<std::string> png = ReadFile(file, kMostStripBytes);
  if (!png.ok()) return WhyNot(png.status().message());
  return Json{{"png", absl::Base64Escape(*png)}};
}

absl::Status GatherSubmission(const ReportOptions& options, Json& order) {
  const Client client = options.client();
  ASSIGN_OR_RETURN(order["result"], ResultForFigures(client, options.id));
  if (order["format"].is_null()) return absl::OkStatus();
  absl::StatusOr<Json> receipt = client.Get(options.Resource("/receipt"));
  if (!receipt.ok() && !absl::IsInvalidArgument(receipt.status())) return receipt.status();
  order["receipt"] = receipt.ok() ? *std::move(receipt) : WhyNot(receipt.status().message());
  if (options.no_pictures) return absl::OkStatus();
  ASSIGN_OR_RETURN(order["strip"], PicturesOf(options));
  return absl::OkStatus();
}

absl::StatusOr<int> WriteReport(const ReportOptions& options) {
  const bool submission = options.id != 0;
  RETURN_IF_ERROR(RefuseIf(
      {{!submission && !options.board.named(),
        "name what to report on: a submission's number, --phase or --track"},
       {submission && options.board.named(),
        "a report covers one submission or one board: give a submission's number, --phase or "
        "--track"}}));
  Json order = {{"make", submission ? "report" : "board-report"}, {"version", MYOGRADE_VERSION}};
  ASSIGN_OR_RETURN(order["format"], ChooseFormat(options, {"html"}));
  CatchStopSignals();
  if (!order["format"].is_null()) RETURN_IF_ERROR(CheckDrawing());
  const absl::Status gathered =
      submission ? GatherSubmission(options, order)
                 : AddWholeBoard(options.client(), options.board, order);
  return DrawInto(options.file, gathered, order, {{"of", submission ? "submission" : "board"}},
                  options.json);
}

}  // namespace

Command AddPlot(CLI::App& verb) {
  auto options = std::make_shared<PlotOptions>();
  std::vector<std::string> kinds;
  for (const PlotKind& kind : kPlotKinds) kinds.emplace_back(kind.name);
  verb.add_option("KIND", options->kind,
                  "board (over time), distributions, courses (results by kind of course), "
                  "survival (how long episodes lasted), joints (angles against limits), paired "
                  "(differences on the same seeds)")
      ->required()
      ->check(CLI::IsMember(kinds));
  verb.add_option("ID", options->ids, "The submissions to show")
      ->type_name("NUMBER")
      ->check(WholeNumber(1, "not a submission's number, as \"myograde status\" lists them"));
  AddBoardChoice(verb, options->board, "The board of this track", "The board of this phase");
  verb.add_option("-o,--output", options->file, "The file to write: FILE.svg or FILE.pdf");
  AddDaemonOptions(verb, "plot", *options, "Print the figure's numbers as JSON");
  return [options] { return Plot(*options); };
}

Command AddReport(CLI::App& verb) {
  auto options = std::make_shared<ReportOptions>();
  AddSubmissionId(verb, *options, /*required=*/false, "The submission to report on");
  AddBoardChoice(verb, options->board,
                 "Instead of a submission: the results of this track outside any phase",
                 "Instead of a submission: the results of this phase");
  verb.add_option("-o,--output", options->file, "The file to write: FILE.html");
  verb.add_flag("--no-pictures", options->no_pictures, "Leave out the pictures of episodes");
  AddDaemonOptions(verb, "report", *options, "Print the report's numbers as JSON");
  return [options] { return WriteReport(*options); };
}

}  // namespace myograde::server
