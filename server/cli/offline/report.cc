// myograde report
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/offline/draw.h"
#include "server/cli/offline/figure_sources.h"
#include "server/cli/offline/stop_signal.h"
#include "server/cli/offline/verbs.h"

namespace myograde::server {
namespace {

constexpr size_t kMostStripBytes = size_t{32} << 20;

struct ReportOptions : SubmissionOptions {
  BoardChoice board;
  std::string file;
  bool no_pictures = false;
};

absl::Status CheckReport(const ReportOptions& options) {
  if (options.id == 0 && !options.board.named()) {
    return absl::InvalidArgumentError(
        "say what the report is of: a submission's number, --phase or --track");
  }
  if (options.id != 0 && options.board.named()) {
    return absl::InvalidArgumentError(
        "a report is of one submission or of one board: give its number, or --phase or --track");
  }
  if (options.file.empty() && !options.json) {
    return absl::InvalidArgumentError(
        "say with -o which file to write, or with --json that you want the numbers");
  }
  if (options.file.empty()) return absl::OkStatus();
  return FormatOf(options.file, {"html"}).status();
}

Json WhyNot(absl::string_view reason) { return {{"error", std::string(reason)}}; }

// What "myograde render" draws of the submission, as Base64, or why there is nothing.
// CancelledError after a stop signal.
absl::StatusOr<Json> PicturesOf(const ReportOptions& options) {
  const absl::StatusOr<TempFolder> temp = TempFolder::Make("strip");
  if (!temp.ok()) return WhyNot(temp.status().message());
  const std::string file = temp->path() + "/strip.png";
  std::vector<std::string> words = {absl::StrCat(options.id), "--strip", "-o", file};
  const std::pair<const char*, const std::string*> places[] = {{"--data", &options.data},
                                                               {"--socket", &options.socket},
                                                               {"--server", &options.server},
                                                               {"--ca-file", &options.ca_file}};
  for (const auto& [option, value] : places) {
    if (!value->empty()) words.insert(words.end(), {option, *value});
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

absl::Status GatherBoard(const ReportOptions& options, Json& order) {
  const Client client = options.client();
  RETURN_IF_ERROR(AddBoard(client, options.board, order));
  RETURN_IF_ERROR(AddPhase(client, order));
  return AddResultsOfBoard(client, order);
}

absl::StatusOr<int> WriteReport(const ReportOptions& options) {
  RETURN_IF_ERROR(CheckReport(options));
  const bool submission = options.id != 0;
  Json order = {{"make", submission ? "report" : "board-report"},
                {"format", options.file.empty() ? Json() : Json("html")},
                {"version", MYOGRADE_VERSION}};
  CatchStopSignals();
  const absl::Status gathered =
      submission ? GatherSubmission(options, order) : GatherBoard(options, order);
  return DrawInto(options.file, gathered, order, {{"of", submission ? "submission" : "board"}},
                  options.json);
}

}  // namespace

Action AddReport(CLI::App& verb) {
  auto options = std::make_shared<ReportOptions>();
  AddSubmissionId(verb, *options, /*required=*/false, "The submission to report on");
  AddBoardChoice(verb, options->board,
                 "In place of a submission: the results of this track outside any phase",
                 "In place of a submission: the results of this phase");
  verb.add_option("-o,--output", options->file, "The file to write: FILE.html");
  verb.add_flag("--no-pictures", options->no_pictures, "Leave out the pictures of episodes");
  AddDaemonOptions(verb, "report", *options, "Print the numbers in the report as JSON");
  return [options] { return WriteReport(*options); };
}

}  // namespace myograde::server
