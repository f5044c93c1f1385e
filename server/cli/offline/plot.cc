// myograde plot
#include <memory>
#include <set>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/offline/draw.h"
#include "server/cli/offline/figure_sources.h"
#include "server/cli/offline/paired_numbers.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/offline/verbs.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

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
  ASSIGN_OR_RETURN(Json paired, PairedNumbers(order["results"][0], order["results"][1]));
  order["paired"] = std::move(paired);
  return absl::OkStatus();
}

int Plot(const PlotOptions& options) {
  if (absl::Status status = CheckPlot(options); !status.ok()) return ReportError(status);
  Json order = {{"make", "plot"}, {"kind", options.kind}, {"format", nullptr}};
  if (!options.file.empty()) {
    const absl::StatusOr<std::string> format = FormatOf(options.file, {"svg", "pdf"});
    if (!format.ok()) return ReportError(format.status());
    order["format"] = *format;
  }
  CatchStopSignals();
  if (absl::Status status = Gather(options, order); !status.ok()) return ReportNotDrawn(status);
  const absl::StatusOr<Drawn> drawn = DrawFigure(order);
  if (!drawn.ok()) return ReportNotDrawn(drawn.status());
  return ReportDrawn(*drawn, options.file,
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
  verb.add_option("--track", options->board.track, "The board of this track");
  verb.add_option("--profile", options->board.profile, "Rules profile (default: the track's own)");
  verb.add_option("--phase", options->board.phase, "The board of this phase");
  verb.add_option("--board", options->board.board, "Name of the board (default: main)");
  verb.add_option("--config", options->board.config,
                  "The board under this config: its hash, or the first 8 digits or more");
  verb.add_option("-o,--output", options->file, "The file to write: FILE.svg or FILE.pdf");
  AddDaemonOptions(verb, "plot", *options, "Print the numbers behind the figure as JSON");
  return [options] { return Plot(*options); };
}

}  // namespace myograde::server
