#include "server/cli/client/client.h"

#include <absl/strings/str_cat.h>

#include <memory>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/log/packed_log.h"
#include "server/cli/base/files.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

// Gets the log of that SHA-256 and gives it to `sink` unpacked, piece by piece. It is the right one
// only if that is OK: DataLossError if it was altered, the daemon's error if it is gone, or what
// `sink` said.
absl::Status ReadLogOf(const Client& client, const std::string& sha256,
                       const LogUnpacker::Sink& sink) {
  Sha256 hash;
  LogUnpacker unpacker([&](std::string_view piece) {
    hash.Update(piece);
    return sink(piece);
  });
  const auto take = [&](std::string_view piece) { return unpacker.Take(piece); };
  RETURN_IF_ERROR(client.Download("/v1/logs/" + sha256, take, /*progress=*/nullptr).status());
  RETURN_IF_ERROR(unpacker.End());
  return CheckLogHash(sha256, hash.FinishHex());
}

// The same of the log that a row names. FailedPreconditionError if the row names none;
// DataLossError names the episode.
absl::Status ReadLogOf(const Client& client, const Json& row, const LogUnpacker::Sink& sink) {
  const Json log = row.value("log", Json());
  const std::string sha256 = log.is_object() ? TextAt(log, "sha256") : "";
  if (sha256.empty()) {
    return absl::FailedPreconditionError(Filled(row, "the log of episode {index} was not kept"));
  }
  const absl::Status status = ReadLogOf(client, sha256, sink);
  if (!absl::IsDataLoss(status)) return status;
  return absl::DataLossError(absl::StrCat(Filled(row, "episode {index}: "), status.message()));
}

// All of the log that a row, or its SHA-256, names.
template <typename Named>
absl::StatusOr<std::string> ReadAllOf(const Client& client, const Named& named) {
  std::string bytes;
  RETURN_IF_ERROR(ReadLogOf(client, named, [&](std::string_view piece) {
    bytes.append(piece);
    return absl::OkStatus();
  }));
  return bytes;
}

struct LogOptions : SubmissionOptions {
  int64_t episode = 0;
  std::string file;
};

absl::StatusOr<int> Log(const LogOptions& options) {
  const Client client = options.client();
  ASSIGN_OR_RETURN(const Json evaluation, EvaluationWithRows(client, options.Resource("/result")));
  ASSIGN_OR_RETURN(const Json row, RowOf(evaluation, options.episode));
  // The file is there only if the log is, whole and unaltered.
  NewFile file(options.file, /*mode=*/0666);
  RETURN_IF_ERROR(file.status());
  const absl::Status status =
      ReadLogOf(client, row, [&](std::string_view piece) { return file.Write(piece); });
  if (!status.ok()) return ExitOfLogError(status);
  RETURN_IF_ERROR(file.Keep().status());
  const Json& log = row["log"];
  const bool whole = log["steps"] == row.value("steps", Json());
  return PrintAnswer(
      Json{{"submission", options.id},
           {"evaluation", evaluation["evaluation"]},
           {"episode", options.episode},
           {"file", options.file},
           {"sha256", log["sha256"]},
           {"bytes", log["bytes"]},
           {"steps", log["steps"]},
           {"complete", whole}},
      options.json,
      Sentence(absl::StrCat("{file}: {bytes:byte}, {steps:step}",
                            whole ? "" : " (the rest did not fit into log_bytes)",
                            ", SHA-256 {sha256}")));
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
  Json row = RowWith(evaluation["episode_rows"], "index", episode);
  if (row.is_object()) return row;
  return absl::OutOfRangeError(absl::StrCat("submission ", evaluation.value("submission", 0),
                                            " has no recorded episode ", episode));
}

absl::StatusOr<std::string> FetchLogBytes(const Client& client, const std::string& sha256) {
  return ReadAllOf(client, sha256);
}

absl::StatusOr<std::string> FetchLogBytes(const Client& client, const Json& row) {
  return ReadAllOf(client, row);
}

absl::StatusOr<EpisodeLog> FetchEpisodeLog(const Client& client, const Json& row) {
  ASSIGN_OR_RETURN(std::string bytes, FetchLogBytes(client, row));
  return ParseEpisodeLog(bytes);
}

Command AddLog(CLI::App& verb) {
  auto options = std::make_shared<LogOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("--episode", options->episode, "The episode, counted from 0")
      ->required()
      ->check(WholeNumber(0, "not an episode's number, counted from 0"));
  verb.add_option("-o,--output", options->file, "The file to write")->required();
  AddDaemonOptions(verb, "log", *options);
  return [options] { return Log(*options); };
}

}  // namespace myograde::server
