// myograde replay
#include <algorithm>
#include <iostream>
#include <map>
#include <memory>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"
#include "server/base/counted.h"
#include "server/base/temp_folder.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/client.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/evaluation_logs.h"
#include "server/cli/offline/play_logs.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"
#include "server/proof/logs.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ReplayOptions : DaemonOptions {
  HostOptions host;
  std::string target;
  int64_t episode = -1;  // -1: all
  int slots = 0;         // 0: as server.json says
};

ReplayRecord Unplayable(int64_t episode, const absl::Status& status) {
  ReplayRecord record;
  record.episode = episode;
  record.differs = {"log"};
  record.detail = std::string(status.message());
  return record;
}

// A folder of the logs to play, by episode, and the records of those that can't be played.
struct Collected {
  std::map<int64_t, ReplayLogFile> files;
  std::map<int64_t, ReplayRecord> records;
};

absl::Status Collect(const Client& client, const Json& row, const std::string& config,
                     const std::string& folder, Collected& collected) {
  const int64_t episode = row.value("index", int64_t{-1});
  absl::StatusOr<std::string> bytes = LogBytesOf(client, row);
  absl::StatusOr<EpisodeLog> log = ParseLog(bytes);
  if (log.ok() && (log->header.config != config || log->header.episode != episode)) {
    log = absl::DataLossError("the log is of another episode or config than its record");
  }
  if (absl::IsDataLoss(log.status())) {
    collected.records[episode] = Unplayable(episode, log.status());
    return absl::OkStatus();
  }
  if (!log.ok()) return log.status();
  ASSIGN_OR_RETURN(ReplayLogFile file, SaveLog(folder, *bytes, std::move(log->header)));
  collected.files[episode] = std::move(file);
  return absl::OkStatus();
}

// The episodes to ask for so that `episode` can be played: all (-1), itself, or its lease until it.
absl::StatusOr<Collected> CollectOfSubmission(const ReplayOptions& options, const Client& client,
                                              const Json& evaluation, const std::string& folder) {
  Collected collected;
  const std::string config = evaluation["hashes"].value("config", "");
  std::vector<Json> rows;
  if (options.episode < 0) {
    rows.assign(evaluation["episode_rows"].begin(), evaluation["episode_rows"].end());
  } else {
    ASSIGN_OR_RETURN(Json row, RowOf(evaluation, options.episode));
    rows.push_back(std::move(row));
  }
  for (const Json& row : rows) {
    RETURN_IF_ERROR(Collect(client, row, config, folder, collected));
  }
  if (options.episode < 0 || collected.files.empty()) return collected;
  const TrackConfig& track = collected.files.begin()->second.header.track;
  if (!CarriesOver(track)) return collected;
  const int64_t first = FirstOfLease(track, options.episode);
  for (int64_t episode = first; episode < options.episode; ++episode) {
    ASSIGN_OR_RETURN(Json row, RowOf(evaluation, episode));
    RETURN_IF_ERROR(Collect(client, row, config, folder, collected));
  }
  return collected;
}

Json RecordToJson(const ReplayRecord& record) {
  return {{"index", record.episode},
          {"equal", record.equal},
          {"steps", record.steps},
          {"step", record.step < 0 ? Json() : Json(record.step)},
          {"differs", record.differs},
          {"detail", record.detail.empty() ? Json() : Json(record.detail)}};
}

int ReportReplay(const ReplayOptions& options, Json head,
                 const std::vector<ReplayRecord>& records) {
  const auto equal = std::count_if(records.begin(), records.end(),
                                   [](const ReplayRecord& record) { return record.equal; });
  const bool all = equal == std::ssize(records) && !records.empty();
  if (options.json) {
    head["equal"] = all;
    head["replayed"] = records.size();
    head["episodes"] = Json::array();
    for (const ReplayRecord& record : records) head["episodes"].push_back(RecordToJson(record));
    PrintJson(head);
  } else {
    for (const ReplayRecord& record : records) {
      if (record.equal) continue;
      std::cout << "episode " << record.episode << ": " << Harmless(record.detail) << '\n';
    }
    std::cout << Bold(absl::StrCat(equal, " of ", Counted(std::ssize(records), "episode"),
                                   " came out as recorded"))
              << std::endl;
  }
  return all ? kDone : kNoScore;
}

int ReplayFile(const ReplayOptions& options) {
  const Json head = {{"submission", nullptr}, {"evaluation", nullptr}, {"file", options.target}};
  absl::StatusOr<std::string> bytes = ReadLog(options.target);
  // No file that could hold a log at all.
  if (absl::IsNotFound(bytes.status()) || absl::IsInvalidArgument(bytes.status())) {
    return ReportError(bytes.status());
  }
  absl::StatusOr<EpisodeLog> log = ParseLog(bytes);
  if (!log.ok()) return ReportReplay(options, head, {Unplayable(0, log.status())});
  const absl::StatusOr<std::map<int64_t, ReplayLogFile>> files =
      LogsUpTo(options.target, log->header);
  if (!files.ok()) return ReportError(files.status());
  const absl::StatusOr<std::vector<ReplayRecord>> records =
      PlayLogs(*files, options.host, options.slots);
  if (!records.ok()) return ReportError(records.status());
  return ReportReplay(options, head, {records->back()});
}

int ReplaySubmission(const ReplayOptions& options, int64_t id) {
  absl::StatusOr<TempFolder> temp = TempFolder::Make("logs");
  if (!temp.ok()) return ReportError(temp.status());
  const Client client = options.client();
  absl::StatusOr<Json> evaluation =
      EvaluationWithRows(client, absl::StrCat("/v1/submissions/", id, "/result"));
  if (!evaluation.ok()) return ReportError(evaluation.status());
  absl::StatusOr<Collected> collected =
      CollectOfSubmission(options, client, *evaluation, temp->path());
  if (!collected.ok()) return ReportError(collected.status());
  absl::StatusOr<std::vector<ReplayRecord>> played =
      PlayLogs(collected->files, options.host, options.slots);
  if (!played.ok()) return ReportError(played.status());
  for (const ReplayRecord& record : *played) collected->records[record.episode] = record;
  std::vector<ReplayRecord> records;
  for (const auto& [episode, record] : collected->records) {
    if (options.episode < 0 || episode == options.episode) records.push_back(record);
  }
  if (records.empty()) {
    return ReportError(absl::FailedPreconditionError(
        absl::StrCat("submission ", id, " has no recorded episode yet")));
  }
  const Json head = {{"submission", id},
                     {"evaluation", (*evaluation)["evaluation"]},
                     {"file", nullptr}};
  return ReportReplay(options, head, records);
}

int Replay(const ReplayOptions& options) {
  int64_t id = 0;
  if (absl::SimpleAtoi(options.target, &id) && id > 0) return ReplaySubmission(options, id);
  if (options.episode >= 0) {
    return ReportError(absl::InvalidArgumentError(
        "--episode: a log file holds one episode; leave the option out"));
  }
  return ReplayFile(options);
}

}  // namespace

Action AddReplay(CLI::App& verb) {
  auto options = std::make_shared<ReplayOptions>();
  verb.add_option("TARGET", options->target,
                  "The submission, or the file of a log (\"myograde log\", \"local --logs\")")
      ->required();
  verb.add_option("--episode", options->episode, "Only this one, counted from 0 (default: all)")
      ->check(WholeNumber(0, "no episode's number, counted from 0"));
  AddSimulatorSlots(verb, options->slots);
  AddDaemonOptions(verb, "replay", *options);
  AddHostOptions(verb, options->host);
  return [options] { return Replay(*options); };
}

}  // namespace myograde::server
