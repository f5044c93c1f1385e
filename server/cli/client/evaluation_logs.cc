#include "server/cli/client/evaluation_logs.h"

#include <absl/strings/str_cat.h>

#include <cerrno>
#include <iostream>
#include <memory>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

std::string HashOf(const Json& row) {
  const auto log = row.find("log");
  if (log == row.end() || !log->is_object()) return "";
  return log->value("sha256", "");
}

// `log`: a SHA-256, or the row that names one.
template <typename Log>
absl::StatusOr<std::string> Collected(const Client& client, const Log& log) {
  std::string bytes;
  RETURN_IF_ERROR(ReadLogOf(client, log, [&](std::string_view piece) {
    bytes.append(piece);
    return absl::OkStatus();
  }));
  return bytes;
}

struct LogOptions : SubmissionOptions {
  int64_t episode = 0;
  std::string file;
};

// The file is there only if the log is, whole and unaltered.
absl::Status FetchLogFile(const Client& client, const Json& row, const std::string& path) {
  NewFile file(path, /*mode=*/0666);
  if (!file.opened()) return CantWrite(path);
  const absl::Status status = ReadLogOf(client, row, [&](std::string_view piece) {
    if (file.Write(piece)) return absl::OkStatus();
    errno = file.error();
    return CantWrite(path);
  });
  return status.ok() ? file.Keep().status() : status;
}

absl::StatusOr<int> Log(const LogOptions& options) {
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json evaluation, EvaluationWithRows(client, options.Resource("/result")));
  ASSIGN_OR_RETURN(const Json row, RowOf(evaluation, options.episode));
  if (const absl::Status status = FetchLogFile(client, row, options.file); !status.ok()) {
    return ExitOfLogError(status);
  }
  const Json& log = row["log"];
  return PrintAnswer(
      Json{{"submission", options.id},
           {"evaluation", evaluation["evaluation"]},
           {"episode", options.episode},
           {"file", options.file},
           {"sha256", log["sha256"]},
           {"bytes", log["bytes"]},
           {"steps", log["steps"]},
           {"complete", log["steps"] == row.value("steps", Json())}},
      options.json, [](const Json& file) {
        std::cout << Cell(file, "file") << ": " << CountCell(file, "bytes", "byte") << ", "
                  << CountCell(file, "steps", "step")
                  << (file["complete"] ? "" : " (the rest did not fit into log_bytes)")
                  << ", SHA-256 " << Cell(file, "sha256") << std::endl;
      });
}

}  // namespace

absl::StatusOr<Json> EvaluationWithRows(const Client& client, const std::string& path) {
  absl::StatusOr<Json> json = client.Get(path + "?episodes=1");
  if (json.ok() && !json->value("episode_rows", Json()).is_array()) {
    return absl::InternalError("the daemon's answer has no episode_rows");
  }
  return json;
}

absl::StatusOr<Json> RowOf(const Json& evaluation, int64_t episode) {
  for (const Json& row : evaluation["episode_rows"]) {
    if (row.value("index", int64_t{-1}) == episode) return row;
  }
  return absl::OutOfRangeError(absl::StrCat("submission ", evaluation.value("submission", 0),
                                            " has no recorded episode ", episode));
}

absl::Status ReadLogOf(const Client& client, const std::string& sha256,
                       const LogUnpacker::Sink& sink) {
  Sha256 hash;
  LogUnpacker unpacker([&](std::string_view piece) {
    hash.Update(piece);
    return sink(piece);
  });
  absl::Status status;
  const absl::StatusOr<int64_t> got = client.Download(
      "/v1/logs/" + sha256,
      [&](const char* data, size_t size) {
        status = unpacker.Take({data, size});
        return status.ok();
      },
      /*progress=*/nullptr);
  if (!status.ok()) return status;
  if (!got.ok()) return got.status();
  if (status = unpacker.End(); !status.ok()) return status;
  return CheckLogHash(sha256, hash.FinishHex());
}

absl::Status ReadLogOf(const Client& client, const Json& row, const LogUnpacker::Sink& sink) {
  const std::string hash = HashOf(row);
  const int64_t episode = row.value("index", int64_t{-1});
  if (hash.empty()) {
    return absl::FailedPreconditionError(absl::StrCat("no log of episode ", episode, " was kept"));
  }
  const absl::Status status = ReadLogOf(client, hash, sink);
  if (!absl::IsDataLoss(status)) return status;
  return absl::DataLossError(absl::StrCat("episode ", episode, ": ", status.message()));
}

absl::StatusOr<std::string> LogBytesOf(const Client& client, const std::string& sha256) {
  return Collected(client, sha256);
}

absl::StatusOr<std::string> LogBytesOf(const Client& client, const Json& row) {
  return Collected(client, row);
}

absl::StatusOr<EpisodeLog> LogOf(const Client& client, const Json& row) {
  ASSIGN_OR_RETURN(std::string bytes, LogBytesOf(client, row));
  return ParseEpisodeLog(bytes);
}

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
