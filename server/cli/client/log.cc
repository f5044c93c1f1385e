// myograde log
#include <cerrno>
#include <iostream>
#include <memory>

#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct LogOptions : SubmissionOptions {
  int64_t episode = 0;
  std::string file;
};

// The file is there only if the log is, whole and unaltered.
absl::Status Fetch(const Client& client, const Json& row, const std::string& path) {
  NewFile file(path, /*mode=*/0666);
  if (!file.opened()) return CantWrite(path);
  const absl::Status status = ReadLogOf(client, row, [&](std::string_view piece) {
    if (file.Write(piece)) return absl::OkStatus();
    errno = file.error();
    return CantWrite(path);
  });
  return status.ok() ? file.Keep().status() : status;
}

int Log(const LogOptions& options) {
  const Client client = options.client();
  const absl::StatusOr<Json> evaluation =
      EvaluationWithRows(client, options.Resource("/result"));
  if (!evaluation.ok()) return ReportError(evaluation.status());
  const absl::StatusOr<Json> row = RowOf(*evaluation, options.episode);
  if (!row.ok()) return ReportError(row.status());
  if (absl::Status status = Fetch(client, *row, options.file); !status.ok()) {
    const int trouble = ReportError(status);
    return absl::IsDataLoss(status) ? kNoScore : trouble;
  }
  const Json& log = (*row)["log"];
  const bool complete = log.value("steps", int64_t{0}) == row->value("steps", int64_t{-1});
  if (options.json) {
    PrintJson({{"submission", options.id},
               {"evaluation", (*evaluation)["evaluation"]},
               {"episode", options.episode},
               {"file", options.file},
               {"sha256", log["sha256"]},
               {"bytes", log["bytes"]},
               {"steps", log["steps"]},
               {"complete", complete}});
  } else {
    std::cout << Harmless(options.file) << ": " << CountCell(log, "bytes", "byte") << ", "
              << CountCell(log, "steps", "step")
              << (complete ? "" : " (the rest did not fit into log_bytes)") << ", SHA-256 "
              << log["sha256"].get<std::string>() << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddLog(CLI::App& verb) {
  auto options = std::make_shared<LogOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--episode", options->episode, "The episode, counted from 0")
      ->required()
      ->check(WholeNumber(0, "no episode's number, counted from 0"));
  verb.add_option("-o,--output", options->file, "The file to write")->required();
  AddDaemonOptions(verb, "log", *options);
  return [options] { return Log(*options); };
}

}  // namespace myograde::server
